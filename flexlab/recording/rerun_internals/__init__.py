"""Every use of what rerun does not promise: should the library change, it is mended here and nowhere else.

`chunks` hands NumPy blocks to `send_columns` as what rerun's own columns look like, and reads its files; `message_layout` knows
how they are put together; `tool` runs its program, asks its server, and unpacks its viewer.
`tests/recording/test_rerun_contract.py` says in a sentence each what of it no longer holds.
"""
