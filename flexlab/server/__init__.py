"""The front server: one address for start page, lab, library of runs and their review, safe to open to a class.

viser has no sign-in, no check of who calls and no pages of its own, so it listens on loopback only, behind this server.
"""
