"""Commands as JSON and back, so that a run can be replayed from its recording."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.state_json import origin_from_values, origin_values
from flexlab.scenario import parse_scenario
from flexlab.sim import commands
from flexlab.sim.commands import ChangeScenario, Command, LoadScenario
from flexlab.sim.world_state import Origin

KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        ChangeScenario,
        commands.Pull,
        commands.Tap,
        LoadScenario,
        commands.Reset,
        commands.Play,
        commands.Pause,
        commands.StepOnce,
        commands.SetSpeed,
    )
}
"""Every command by its class name, which is its `kind` in JSON."""


def command_to_json(command: Any) -> str:
    """One line of JSON: {"kind": class name, field: value, …}. Numbers keep every bit."""
    if not is_dataclass(command):
        return json.dumps({"kind": type(command).__name__})
    values = {field.name: _plain(getattr(command, field.name)) for field in fields(command)}
    return json.dumps({"kind": type(command).__name__, **values}, ensure_ascii=False)


def command_from_json(text: str) -> Command:
    """The command that `command_to_json` was given. Raises `RecordingError` for anything else."""
    try:
        values = json.loads(text)
        kind = KINDS[values.pop("kind")]
        if kind is ChangeScenario:
            values.setdefault("keeps_target", False)
        if kind is LoadScenario:
            values["scenario"] = parse_scenario(values["scenario"])
            if values.get("origin") is not None:
                values["origin"] = origin_from_values(values["origin"])
        return kind(**{name: _frozen(value) for name, value in values.items()})
    except (ValueError, KeyError, TypeError, AttributeError, FlexlabError) as error:
        raise RecordingError(
            f"The recording has a command that this version of flexlab cannot read ({error}): {text[:80]}"
        ) from None


def _plain(value: Any) -> Any:
    """The value with JSON's types only."""
    if isinstance(value, Origin):
        return origin_values(value)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value


def _frozen(value: Any) -> Any:
    """Lists as the tuples they were."""
    if isinstance(value, dict):
        return {name: _frozen(item) for name, item in value.items()}
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
