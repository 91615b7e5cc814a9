"""The cases; a new file beside `standard.py` adds one."""
