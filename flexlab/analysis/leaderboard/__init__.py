"""The benchmark: control laws on the same cases, B1 to B8, with scores that have a formula and a unit.

`case.py` what a case and a score are, `cases/` the cases, `entry.py` the laws that enter, with which settings, and one of them in
one case, `store.py` rows on disk under keys of what they depend on, `board.py` all of them, and the same again, bit for bit,
`report.py` what tables and figures say.
"""
