"""All uses of rerun's internals, which rerun does not promise to keep: if they change, only this package has to follow.

`chunks` begins streams, sends NumPy blocks to them as rerun's own columns, and reads rerun's files; `rrd_file` knows the layout
of these files, and writes them; `tool` runs rerun's program, asks its server, and unpacks its viewer.
`tests/recording/test_rerun_contract.py` names each assumption that no longer holds, in a sentence.
"""
