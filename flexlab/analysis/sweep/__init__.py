"""Sweeps: one scenario with some fields varied over ranges, a thousand runs, one table of their metrics.

`axes.py` what is varied, `plan.py` which cells that makes and one of them, `execution.py` all of them on this machine or a
cluster, `result.py` the table and what Python users get, `figures.py` what it looks like.
"""
