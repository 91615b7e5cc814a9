"""Explanations of a run: sentences computed from its numbers, each registered by a file here (see `explanation.py`)."""

from flexlab.registry import modules_in

modules_in(__name__)
