"""Commands and a world's state as JSON and back; numbers keep every bit."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from flexlab.errors import FlexlabError, RecordingError
from flexlab.physics.plant import AXIAL_WORK
from flexlab.scenario import parse_scenario
from flexlab.sim import commands
from flexlab.sim.commands import ChangeScenario, Command, LoadScenario
from flexlab.sim.world_state import Origin, WorldState

LAYOUT, PRESENT_LAYOUT = "layout", 3
"""Which order the numbers of y have; states of layout 1 do not name it."""


def state_json(state: WorldState) -> str:
    """A world's state as JSON."""
    return json.dumps(_state_values(state))


def state_from_json(text: str) -> WorldState:
    """The state that `state_json` was given. Raises ValueError, KeyError or TypeError for anything else."""
    return _state(json.loads(text))


def origin_values(origin: Origin) -> dict[str, Any]:
    """An origin in JSON's types."""
    return {"run": origin.run, "time": origin.time, "state": _state_values(origin.state)}


def origin_from_values(values: Mapping[str, Any]) -> Origin:
    """The origin that `origin_values` was given. Raises ValueError, KeyError or TypeError for anything else."""
    return Origin(str(values["run"]), float(values["time"]), _state(values["state"]))


def _state_values(state: WorldState) -> dict[str, Any]:
    values = {field.name: getattr(state, field.name) for field in fields(WorldState)}
    numbers = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    return {LAYOUT: PRESENT_LAYOUT, **numbers}


def _state(values: Mapping[str, Any]) -> WorldState:
    # What only a newer version keeps is of no use here; what it needs and an older one lacks has a default.
    known = {field.name for field in fields(WorldState)} - {"tick"}
    arrays = {name: np.array(value, float) for name, value in values.items() if name in known}
    layout = values.get(LAYOUT, 1)
    if layout == 1:
        arrays["y"] = from_first_layout(arrays["y"])
    if layout <= 2:
        arrays["y"] = from_second_layout(arrays["y"])
    return WorldState(tick=int(values["tick"]), **arrays)


def from_first_layout(y: np.ndarray) -> np.ndarray:
    """A state y of layout 1 in layout 2: b̂ stood before the energies, and was every law's memory."""
    return np.concatenate([y[:6], y[9:], y[6:9]])


def from_second_layout(y: np.ndarray) -> np.ndarray:
    """A state y of layout 2 in the present one (`physics.plant`), which has the work of the axial load: there was none."""
    return np.insert(y, AXIAL_WORK, 0.0)


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
