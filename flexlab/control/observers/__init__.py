"""Observers of the beam for sampled controllers."""
