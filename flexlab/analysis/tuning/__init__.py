"""Tuning: the parameters, within stated bounds, for which runs cost least.

`cost.py` what is to be small and what must not be exceeded, `search.py` the search, `figure.py` the trade-off among what it
tried.
"""
