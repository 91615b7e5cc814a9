"""Sweeps: one scenario with some fields varied over ranges, a thousand runs, one table of their metrics.

`axes.py` what is varied, `plan.py` which cells that makes, `cell.py` one of them, `table.py` the table and its parts on disk,
`execution.py` all of them on this machine or a cluster, `figures.py` what it looks like, `result.py` what Python users get.
"""
