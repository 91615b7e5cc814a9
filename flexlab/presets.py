"""Presets and scenario files in JSON, and the other forms of a scenario in the Python interface.

A preset is a scenario file `<name>.json`, flexlab's or in a person's own folder `presets`. The name of one of flexlab's presets
always means that one, so that "paper" is the paper everywhere. A file may leave out fields with default values; `menu_order` is
the preset's place in menus. Editors check scenario files by their JSON schema.
"""

import difflib
import json
import math
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from flexlab.arguments import file_path
from flexlab.assets import presets_folder
from flexlab.errors import FlexlabError, PresetError, ScenarioError, StudyError
from flexlab.files import DuplicateField, check_ordinary, unique_fields, writing
from flexlab.own.declaration import OwnLaw, OwnPath
from flexlab.own.files import law_kind
from flexlab.scenario import parse_scenario
from flexlab.scenario.field_text import differences, told, value_text
from flexlab.scenario.path_file import known_kind, path_choice
from flexlab.scenario.scenario import FORMAT, FORMAT_FIELD, MENU_FIELD, SCHEMA_FIELD, Scenario
from flexlab.text import REPLACEMENT, writable

REFERENCE = "schema/scenario.json"
"""Path of the schema relative to the presets, as they give it."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """The JSON schema of scenario files, with the range of every number."""
    schema = Scenario.model_json_schema()
    schema["properties"] |= {
        SCHEMA_FIELD: {"type": "string", "description": "Where this schema lies, for editors."},
        FORMAT_FIELD: {"type": "integer", "minimum": 1, "maximum": FORMAT, "description": "Format of this file."},
        MENU_FIELD: {
            "type": "integer",
            "description": "Place among the presets of its folder: a smaller number first.",
        },
    }
    return {SCHEMA_FIELD: DIALECT, **schema}


def write_schema(presets: Path) -> Path:
    """Write the schema into a folder `presets`; returns its path. Raises OSError."""
    file = presets / REFERENCE
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(scenario_schema(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    file.write_text(text, encoding="utf-8")
    return file


OWN_FOLDER = Path("presets")
"""A person's own presets, relative to the working directory."""
LARGEST_FILE = 5_000_000
"""The most bytes of a scenario file: five times what the longest table of a path needs."""
_NO_ADDRESS = re.compile(r"[\\\x00-\x1f\x7f]|\A\.+\Z")
"""What the addresses of pages cannot hold of names: control characters, backslashes, and dots alone."""
_NUMBER_LIST = re.compile(r"\[\s+([^\[\]{}\"]*?)\s+\]")


def preset_files(own: str | Path = OWN_FOLDER) -> dict[str, Path]:
    """Name → file of every preset: flexlab's own first, then those of the folder `own`, each by `menu_order`, then by name.

    Raises `PresetError` for a folder that cannot be looked into, such as one whose name is too long.
    """
    own, ours = file_path("own", own), presets_folder()
    try:
        with suppress(FileNotFoundError, NotADirectoryError):
            own.stat()  # From Python 3.13 on, glob keeps errors to itself.
        found = [path for folder in (own, ours) for path in sorted(folder.glob("*.json"))]
    except OSError as error:
        raise PresetError(f"own = {str(own)!r:.60} cannot be read ({error.strerror}): name another folder.") from None
    files: dict[str, Path] = {}
    for path in found:
        name = preset_name(path.stem)
        while (
            name in files and files[name].parent == path.parent
        ):  # Names that differ in characters that were replaced.
            name += REPLACEMENT
        files[name] = path
    return dict(sorted(files.items(), key=lambda item: (item[1].parent != ours, _menu_order(item[1]), item[0])))


def preset_name(stem: str) -> str:
    """The name of the preset in a file: the file's, where pages, menus and recordings can hold it.

    Those of old archives are not UTF-8, and a line break or "." has no address.
    """
    return _NO_ADDRESS.sub(REPLACEMENT, writable(stem))


def preset_names(own: str | Path = OWN_FOLDER) -> list[str]:
    """The names of all presets, in the order of `preset_files`."""
    return list(preset_files(own))


def load_preset(name: str, own: str | Path = OWN_FOLDER) -> Scenario:
    """The scenario of preset `name`. Raises `PresetError` (unknown or unreadable) or `ScenarioError` (not valid)."""
    files = preset_files(own)
    if not isinstance(name, str) or name not in files:
        raise PresetError(_unknown(str(name), list(files)))
    return load_scenario_file(files[name])


def load_scenario_file(path: str | Path) -> Scenario:
    """The scenario in a JSON file. Raises `PresetError` (unreadable, not JSON) or `ScenarioError` (not valid)."""
    return read_scenario(_content(Path(path)), path)


def read_scenario(content: bytes, name: str | Path) -> Scenario:
    """The scenario in a JSON file with that content; errors call it `name`. Raises `PresetError` or `ScenarioError`."""
    try:
        return parse_scenario(_parsed(content, name))
    except ScenarioError as error:
        raise ScenarioError([(field, f"{name}: {sentence}") for field, sentence in error.problems]) from None


def find_scenario(name_or_path: str) -> tuple[str, Scenario]:
    """(short name, scenario) of a preset or a scenario file, given by name or path as people type it.

    Raises `PresetError` or `ScenarioError`.
    """
    if (name := preset_name(name_or_path)) in preset_files():
        return name, load_preset(name)
    if name_or_path.endswith(".json") or "/" in name_or_path or "\\" in name_or_path:
        return preset_name(Path(name_or_path).stem), load_scenario_file(name_or_path)
    raise PresetError(_unknown(name_or_path, preset_names()))


AnyScenario = Scenario | str | Path | Mapping[str, Any]
"""A scenario; a preset's name; the path of a scenario file; or plain data, as read from JSON."""
AnyLaw = str | Path | type[OwnLaw] | None
"""A control law by its name, the path of a Python file that holds one, or a class; None: the scenario's."""
AnyPath = str | Path | type[OwnPath] | None
"""A path by its name, a CSV file, a Python file, or a class; None: the scenario's."""


def any_scenario(given: AnyScenario) -> Scenario:
    """The scenario that `given` stands for. Raises `PresetError`, `ScenarioError`, or `StudyError` if for none."""
    return given if isinstance(given, Scenario) else named_scenario(given)[1]


def named_scenario(given: AnyScenario, law: AnyLaw = None, path: AnyPath = None) -> tuple[str, Scenario]:
    """(short name, scenario with this law and path). Raises `PresetError`, `ScenarioError` or `StudyError`."""
    if isinstance(given, (str, Path)):
        name, scenario = find_scenario(str(given))
    elif isinstance(given, (Scenario, Mapping)):
        scenario = given if isinstance(given, Scenario) else parse_scenario(given)
        name = telling_name(scenario)
    else:
        raise StudyError(
            f'{type(given).__name__} is not a scenario: give a Scenario, the name of a preset such as "paper", '
            "the path of a scenario file, or a dictionary of its fields."
        )
    return name, law_and_path(law, path)(scenario)


def law_and_path(law: AnyLaw, path: AnyPath) -> Callable[[Scenario], Scenario]:
    """A function that returns a scenario with this law and path. Both raise `ScenarioError` or `PresetError`."""
    changes = {} if law is None else {"controller.kind": known_kind("controller.kind", law_kind(law))}
    along = None if path is None else path_choice(path)

    def chosen(scenario: Scenario) -> Scenario:
        changed = scenario.replace(changes) if changes else scenario
        return changed if along is None else along(changed)

    return chosen


MOST_TOLD, LONGEST_TOLD = 3, 80
"""Most changes in a run's name, and most characters of it."""


def telling_name(scenario: Scenario, base: str = "") -> str:
    """A name for runs of a scenario: its preset and what was changed, as in "paper-kind-pd".

    `base`: the preset; if empty it is found by its title, and the name is "run" if no preset has that title.
    """
    files = preset_files()
    known = tuple((name, path.stat().st_mtime_ns) for name, path in files.items() if path.exists())
    base = base or _titles(known).get(scenario.title, "")
    if base not in files:
        return base or "run"
    news = told(differences(load_preset(base), scenario))
    changes = [f"{path.rpartition('.')[2]}-{value_text(value)}" for path, _, value in news]
    if len(changes) > MOST_TOLD:
        changes = [*changes[:MOST_TOLD], f"{len(changes) - MOST_TOLD}-more"]
    return re.sub(r"[^\w.+-]+", "_", "-".join([base, *changes]))[:LONGEST_TOLD]


@lru_cache(maxsize=4)
def _titles(known: tuple[tuple[str, int], ...]) -> dict[str, str]:
    """Title → preset, for presets and the dates of their files, which are the cache's key."""
    found: dict[str, str] = {}
    for name, _ in known:
        with suppress(FlexlabError):
            found.setdefault(load_preset(name).title, name)
    return found


def save_scenario(scenario: Scenario, path: str | Path) -> None:
    """Write a scenario as JSON: title, watch and schema first, every field, one line per list. Raises `PresetError`."""
    with writing(Path(path), kind=PresetError) as draft:
        draft.write_text(scenario_text(scenario), encoding="utf-8")


def scenario_text(scenario: Scenario) -> str:
    """The JSON text of a scenario, as `save_scenario` writes it."""
    fields = _kind_first(scenario.model_dump(mode="json"))
    del fields["trajectory"]["transition"]  # It belongs to a change in motion; a file starts a new run.
    said = {"title": fields.pop("title"), "watch": fields.pop("watch")}
    data = {**said, SCHEMA_FIELD: REFERENCE, FORMAT_FIELD: FORMAT, **fields}
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)
    return _NUMBER_LIST.sub(lambda match: "[" + re.sub(r"\s+", " ", match[1]) + "]", text) + "\n"


def _menu_order(path: Path) -> float:
    """A preset's place in menus, at the end if its file gives none."""
    try:
        return _read_menu_order(path, path.stat().st_mtime_ns)
    except (OSError, PresetError):
        return math.inf


@lru_cache(maxsize=1024)
def _read_menu_order(path: Path, changed: int) -> float:
    """`_menu_order` of a file, cached for its date `changed`."""
    data = _parsed(_content(path), path)
    order = data.get(MENU_FIELD) if isinstance(data, dict) else None
    return order if type(order) is int else math.inf


def _kind_first(data: Any) -> Any:
    if not isinstance(data, dict):
        return data
    order = sorted(data, key=lambda name: name != "kind")
    return {name: _kind_first(data[name]) for name in order}


def _content(path: Path) -> bytes:
    try:
        check_ordinary(path)
        if path.stat().st_size > LARGEST_FILE:
            raise PresetError(f"{path} has more than {LARGEST_FILE // 1_000_000} MB: name a file with a scenario.")
        return path.read_bytes()
    except FileNotFoundError:
        raise PresetError(f"There is no scenario file {path}: check the name.") from None
    except OSError as error:
        raise PresetError(f"{path} cannot be read: {error.strerror}.") from None
    except ValueError as error:  # A name that no file can have.
        raise PresetError(f"{path} cannot be read as a scenario: {_lower_first(str(error))}.") from None


def _parsed(content: bytes, name: str | Path) -> Any:
    try:
        # Windows PowerShell writes `flexlab presets paper > mine.json` in UTF-16.
        return json.loads(content.decode(json.detect_encoding(content)), object_pairs_hook=unique_fields)
    except UnicodeDecodeError:
        raise PresetError(f"{name} is not a text file in UTF-8: a scenario file is JSON text.") from None
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise PresetError(f"{name}, {where}, is not valid JSON: {_lower_first(error.msg)}.") from None
    except DuplicateField as error:
        raise PresetError(f"{name} cannot be read as a scenario: {error}.") from None
    except RecursionError:
        raise PresetError(f"{name} cannot be read as a scenario: its parts are nested too deeply.") from None
    except ValueError:  # Python converts no longer integers.
        most = sys.get_int_max_str_digits()
        raise PresetError(f"{name} cannot be read as a scenario: a number has more than {most} digits.") from None


def _unknown(name: str, names: list[str]) -> str:
    close = difflib.get_close_matches(name.lower(), names, n=1)
    hint = f"; did you mean {close[0]}?" if close else "."
    return f"There is no preset {name!r:.60}: the presets are {', '.join(names)}{hint}"


def _lower_first(text: str) -> str:
    return text[:1].lower() + text[1:].split("\n")[0].rstrip(".")
