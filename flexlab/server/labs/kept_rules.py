"""What a teacher asks of a class, kept beside the runs: a server that is started again goes on with it."""

from dataclasses import asdict
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from flexlab.guide import STEPS
from flexlab.lab.class_rules import ClassRules
from flexlab.recording.store.notes import read_notes, write_notes

FILE = Path(".class")
"""In the folder of the runs; `notes` gives it its ending."""
RULES = "rules"
MOST_CHARACTERS = 200
"""Of a lesson's name."""

_RULES = TypeAdapter(ClassRules)


def keep_rules(logs: Path, rules: ClassRules) -> None:
    """Keep them for the next server of this folder. Raises OSError."""
    logs.mkdir(parents=True, exist_ok=True)
    write_notes(logs / FILE, **{RULES: asdict(rules)})


def kept_rules(logs: Path) -> ClassRules:
    """Those that were kept; none for a file that is not there or says something else."""
    try:
        rules = _RULES.validate_python(read_notes(logs / FILE).get(RULES, {}))
    except ValidationError:
        return ClassRules()
    return rules if 1 <= rules.step <= len(STEPS) and len(rules.lesson) <= MOST_CHARACTERS else ClassRules()
