"""What can be said of a run, sentences computed from its numbers.

A file here that registers an explanation is all that a new one takes; `explanation.py` says how.
"""

import pkgutil
from importlib import import_module

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

for module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{module.name}")

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
