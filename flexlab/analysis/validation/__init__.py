"""Validation of this installation against the paper and mechanics.

The references are independent of the engine: closed formulas, the numbers of an independent solution, published values, and the
mechanics of mass points.
"""

from flexlab.analysis.validation.check import Check, Validation, validate

__all__ = ["Check", "Validation", "validate"]
