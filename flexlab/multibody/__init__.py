"""A scenario's mechanics as rigid bodies, springs and dampers, in the files that other simulators of robots read."""

from pathlib import Path

from flexlab.errors import StudyError
from flexlab.multibody.bodies import make_bodies
from flexlab.multibody.formats import mjcf_text, urdf_text
from flexlab.recording.store.notes import replacing
from flexlab.scenario import Scenario

WRITERS = {".urdf": urdf_text, ".xml": mjcf_text, ".mjcf": mjcf_text}
"""By what a file's name ends in."""


def write_bodies(scenario: Scenario, file: Path, name: str = "scenario") -> Path:
    """Write a scenario's arms and beam as .urdf, or for MuJoCo as .xml or .mjcf; returns the file.

    Raises `ScenarioError` for a scenario that cannot start, and `StudyError`.
    """
    text = WRITERS[file.suffix.lower()](make_bodies(scenario), name)
    try:
        with replacing(file) as draft:
            draft.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{file} cannot be written ({error.strerror}): choose another file.") from None
    return file
