"""Identification of a beam from its free vibration.

`estimates.py`: numbers with intervals; `ring.py`: frequencies and damping ratios; `evidence.py`: whether there is a ring, and
what the modes leave out; `beam_parameters.py`: the stiffness and damping that give a scenario the same ring, and CSV files;
`fitting.py`: the whole fit; `free_ring.py`: where a run rings; `remedies.py`: remedies.
"""
