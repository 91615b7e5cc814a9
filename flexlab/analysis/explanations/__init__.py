"""Explanations of a run: sentences computed from its numbers.

To add one, add a file here that registers it; `explanation.py` says how.
"""

from flexlab.registry import modules_in

modules_in(__name__)
