"""Identification: what a measured ring says of the beam.

`ring.py` frequencies and damping of decaying vibrations with intervals, `measured.py` other people's CSV files,
`beam_parameters.py` which stiffness and damping a scenario needs to ring like that.
"""
