"""Every use of what rerun does not promise: should the library change, it is mended here and nowhere else.

`chunks` begins streams, hands NumPy blocks to them as rerun's own columns, and reads its files; `rrd_file` knows how they are
put together, and writes them; `tool` runs its program, asks its server, and unpacks its viewer.
`tests/recording/test_rerun_contract.py` says in a sentence each what of it no longer holds.
"""
