"""Recordings: every run as a rerun file that can be watched live, found again, and read back bit for bit.

Only this package imports rerun. Rerun's log lines are off unless RUST_LOG is set: this package reports problems with files
and ports in sentences of its own.
"""

import os

os.environ.setdefault("RUST_LOG", "off")
