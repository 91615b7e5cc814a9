"""Recordings: every run as a rerun file, watched live, found again, read back bit for bit.

The only room that imports rerun. Rerun's own log lines are switched off unless the person sets RUST_LOG: what goes wrong
with a file or a port is said in this package's sentences, and twice is once too often.
"""

import os

os.environ.setdefault("RUST_LOG", "off")
