"""Explanations of a run: sentences computed from its numbers.

To add one, add a file here that registers it; `explanation.py` says how.
"""

from flexlab.analysis.explanations.explanation import (
    EXPLANATIONS,
    LONGEST_LOOK,
    Background,
    Evidence,
    Explained,
    Explanation,
    explain,
    explain_run,
    register,
)
from flexlab.registry import modules_in

modules_in(__name__)

__all__ = [
    "EXPLANATIONS",
    "LONGEST_LOOK",
    "Background",
    "Evidence",
    "Explained",
    "Explanation",
    "explain",
    "explain_run",
    "register",
]
