"""Validation of this installation by closed formulas, published values, another solution and mechanics of mass points."""

from flexlab.analysis.validation.check import Check, Validation, validate

__all__ = ["Check", "Validation", "validate"]
