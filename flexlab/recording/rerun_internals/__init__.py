"""Every use of what rerun does not promise: should the library change, it is mended here and nowhere else.

`columns` hands NumPy blocks to `send_columns` as what rerun's own columns look like; `message_layout` knows how its files are
put together; `chunk_reader` reads them; `tool` runs its program; `catalog` asks its server; `viewer_files` unpacks its viewer.
`tests/recording/test_rerun_contract.py` says in a sentence each what of it no longer holds.
"""
