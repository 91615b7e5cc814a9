"""Sweeps: one scenario with some fields varied over ranges, and a table with the metrics of all runs.

`axes.py`: the varied fields; `plan.py`: the cells, and how one is computed; `result.py`: all cells, and their table;
`figures.py`: its figures.
"""
