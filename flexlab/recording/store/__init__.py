"""The logs folder: files, notes, the index of runs, and which runs may be deleted."""
