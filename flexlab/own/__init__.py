"""Control laws and paths that a person writes in Python: what their text declares, and how it runs."""
