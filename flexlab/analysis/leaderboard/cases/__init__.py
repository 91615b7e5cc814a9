"""The cases: a file of one's own beside `standard.py` adds one."""
