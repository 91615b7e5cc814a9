"""Identification: what a measured ring says of the beam.

`ring.py` frequencies and damping of decaying vibrations with intervals, `beam_parameters.py` which stiffness and damping a
scenario needs to ring like that or like other people's CSV files, `remedies.py` what helps against it.
"""
