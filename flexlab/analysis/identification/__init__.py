"""Identification of a beam from its free vibration.

`ring.py`: frequencies and damping ratios with intervals; `evidence.py`: whether there is a ring, and what the modes
leave out; `beam_parameters.py`: the stiffness and damping with which a scenario rings alike, and CSV files; `fitting.py`: the
whole fit; `remedies.py`: remedies.
"""
