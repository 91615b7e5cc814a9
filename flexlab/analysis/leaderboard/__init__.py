"""The benchmark: control laws on the same cases, B1 to B8, with scores that have a formula and a unit.

`case.py`: cases and scores; `cases/`: the cases; `entry.py`: the laws that enter, and the computation of a row; `store.py`: rows
on disk; `figures.py`: a case's figure; `board.py`: all rows, and their verification; `report.py`: tables and report.
"""
