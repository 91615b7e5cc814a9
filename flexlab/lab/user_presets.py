"""Scenarios as files of a person's own: saved as presets, downloaded, uploaded."""

import re
import tempfile
import unicodedata
from pathlib import Path

from flexlab.assets import presets_folder
from flexlab.errors import PresetError, ScenarioError
from flexlab.presets import OWN_FOLDER, load_scenario_file, save_scenario
from flexlab.scenario import Scenario

LONGEST_NAME = 40
"""Characters of a name: what a menu shows."""


MOST_PRESETS = 60
"""Files in a person's own folder: as many as a menu can hold, and no visitor fills the disk."""


def save_preset(scenario: Scenario, name: str, folder: Path = OWN_FOLDER) -> Path:
    """Write a scenario as a person's own preset; raises `PresetError` for a name that cannot be used.

    The file's name is the name in small letters, digits and hyphens.
    """
    title, name = name, file_stem(name)
    if not name or len(title) > LONGEST_NAME or not title.isprintable() or re.search(r"[/\\]", title):
        raise PresetError(
            f"{title[:60]!r} cannot be a preset's name: use 1 to {LONGEST_NAME} characters, a letter or a digit among them "
            "and no slash, as in My soft beam."
        )
    if (presets_folder() / f"{name}.json").exists():
        raise PresetError(f"{name} is a preset of flexlab itself and stays as it is: choose another name.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PresetError(f"The folder {folder} cannot be made ({error.strerror}): start flexlab elsewhere.") from None
    path = folder / f"{name}.json"
    if not path.exists() and sum(1 for _ in folder.glob("*.json")) >= MOST_PRESETS:
        raise PresetError(
            f"There are {MOST_PRESETS} presets in {folder} already: delete some, or save under one's name."
        )
    save_scenario(scenario, path)
    return path


def file_stem(name: str) -> str:
    """A name as every file system, link and command line takes it: small letters, digits and hyphens; may be empty."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", plain.lower())[:LONGEST_NAME].strip("-")


def read_upload(file_name: str, content: bytes) -> tuple[str, Scenario]:
    """(short name, scenario) of an uploaded file; raises `PresetError` or `ScenarioError` with the file's own name."""
    stem = file_stem(Path(file_name).stem) or "uploaded"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{stem}.json"
        path.write_bytes(content)
        try:
            return stem, load_scenario_file(path)
        except ScenarioError as error:
            raise ScenarioError([(field, _own(text, path)) for field, text in error.problems]) from None
        except PresetError as error:
            raise PresetError(_own(str(error), path)) from None


def _own(text: str, path: Path) -> str:
    return text.replace(str(path), path.name)
