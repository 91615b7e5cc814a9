"""`flexlab review`: look at a recording."""
