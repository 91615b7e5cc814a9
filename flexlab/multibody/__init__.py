"""A scenario's mechanics as rigid bodies, springs and dampers, in the formats of other robot simulators."""

from pathlib import Path

from flexlab.files import write_text
from flexlab.multibody.bodies import make_bodies
from flexlab.multibody.formats import mjcf_text, urdf_text
from flexlab.scenario import Scenario

WRITERS = {".urdf": urdf_text, ".xml": mjcf_text, ".mjcf": mjcf_text}
"""Writers by the ending of a file's name."""


def write_bodies(scenario: Scenario, file: Path, name: str = "scenario") -> Path:
    """Write a scenario's arms and beam as .urdf, or for MuJoCo as .xml or .mjcf, and return the file.

    Raises `ScenarioError` for a scenario that cannot start, and `StudyError`.
    """
    write_text(file, WRITERS[file.suffix.lower()](make_bodies(scenario), name))
    return file
