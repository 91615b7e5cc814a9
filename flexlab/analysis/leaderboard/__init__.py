"""The benchmark: control laws on the same cases, B1 to B7, with scores that have a formula and a unit.

`score.py` what a score is, `case.py` what a case is, `cases/` one file each, `entrants.py` the laws that enter and with which
settings, `row.py` one law in one case, `content.py` what a row depends on, `store.py` rows on disk, `board.py` all of them,
`verification.py` the same again, bit for bit, `summary.py` what the tables say, `figures.py` and `report.py` what they look like.
"""
