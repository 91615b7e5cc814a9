"""Observers of the beam for sampled controllers, a file each; `observer.py` is what they share."""
