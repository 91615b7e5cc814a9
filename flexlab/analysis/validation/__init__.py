"""Validation: whether what this installation computes is what the paper and mechanics say.

Each module of this folder states facts about one subject, and checks them against something that this package did not compute:
closed formulas, the numbers of an independent solution, and mechanics of mass points without its matrices.
"""

from flexlab.analysis.validation.check import Check, Validation, validate

__all__ = ["Check", "Validation", "validate"]
