"""The JSON schema for editors: it follows the fields, states every range, and is named by the presets."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexlab.assets import presets_folder
from flexlab.errors import ScenarioError
from flexlab.presets import REFERENCE, load_scenario_file, preset_names, save_scenario
from flexlab.scenario import Scenario, parse_scenario


def test_the_command_writes_the_schema_where_the_presets_look_for_it(flexlab_command, tmp_path: Path):
    done = flexlab_command("presets", "--schema")
    assert done.returncode == 0, done.stderr
    assert "presets/schema/scenario.json is written" in done.stdout.replace("\\", "/")
    file = tmp_path / "presets" / REFERENCE
    schema = json.loads(file.read_text(encoding="utf-8"))
    for name in preset_names():
        data = json.loads((presets_folder() / f"{name}.json").read_text(encoding="utf-8"))
        assert file.parent.parent / data["$schema"] == file
        assert set(data) <= set(schema["properties"])
    file.unlink()
    file.parent.rmdir()
    file.parent.write_text("in the way")
    done = flexlab_command("presets", "--schema")
    assert (done.returncode, "cannot be written" in done.stderr) == (2, True)


def numbers(schema: Any, root: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """(path, schema) of every number in a schema."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    if schema.get("type") in ("number", "integer"):
        yield path, schema
    for name, inner in schema.get("properties", {}).items():
        yield from numbers(inner, root, f"{path}.{name}" if path else name)
    items = schema.get("items")
    for key in ("anyOf", "oneOf", "prefixItems"):
        for inner in schema.get(key, []):
            yield from numbers(inner, root, path)
    if isinstance(items, dict):
        yield from numbers(items, root, path)


def test_every_number_states_its_range():
    schema = Scenario.model_json_schema()
    found = dict(numbers(schema, schema))
    assert len(found) > 40
    assert [
        path for path, number in found.items() if "enum" not in number and not {"minimum", "maximum"} <= set(number)
    ] == []
    assert (found["payload.bending_stiffness"]["minimum"], found["payload.bending_stiffness"]["maximum"]) == (
        1e-3,
        1e12,
    )


def test_a_scenario_accepts_the_ends_of_the_schemas_ranges_and_nothing_beyond():
    schema = Scenario.model_json_schema()
    for path in ("payload.length", "gravity", "simulation.accuracy"):
        number = dict(numbers(schema, schema))[path]
        for end in ("minimum", "maximum"):
            assert Scenario().replace({path: number[end]}).get(path) == number[end]
            with pytest.raises(ScenarioError):
                Scenario().replace({path: number[end] + (1 if end == "maximum" else -1) * max(1.0, abs(number[end]))})


def test_the_reference_to_the_schema_is_no_field_of_the_scenario(tmp_path):
    assert parse_scenario({"$schema": "anywhere.json", "gravity": 1.0}) == Scenario(gravity=1.0)
    with pytest.raises(ScenarioError, match=r"\$schema"):
        parse_scenario({"$schema": 5})
    with pytest.raises(ScenarioError, match="is not a scenario field"):
        parse_scenario({"payload": {"$schema": "x"}})
    save_scenario(Scenario(gravity=2.0), tmp_path / "mine.json")
    assert load_scenario_file(tmp_path / "mine.json") == Scenario(gravity=2.0)
