"""The logs folder: files, notes, the index of runs, and which of them may go."""
