"""Settings as people type them, `controller.feedback_gain=400`, applied to a scenario."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from flexlab.errors import ScenarioError
from flexlab.files import DuplicateField, unique_fields
from flexlab.scenario.scenario import Scenario
from flexlab.scenario.validation_errors import LONGEST
from flexlab.text import visible

LAW, SEED = "controller.kind", "controller.sensor_noise.seed"
"""The fields behind `--law` and `--seed`."""
PERIOD, USUAL_PERIOD = "controller.control_period", 0.001
"""The field, and the period, s, that sampled laws get when they are chosen for a continuous loop."""
IDEAL: dict[str, Any] = {
    "controller.input_delay": 0,
    "controller.sensor_noise": {},
    "controller.torque_limit": None,
    "joints.encoders": {},
    "joints.motor": {},
    "grips": {},
}
"""Changes that take away delay, noise, torque limits, encoders, motors and compliant grips, for linear models."""


def parse_setting(text: str) -> tuple[str, Any]:
    """(dotted path, value) of `PATH=VALUE`: the value as JSON, or else as text (`kind=pd`).

    Raises `ScenarioError` for a text without a path or an equals sign, or as `parse_value` does.
    """
    path, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not path:
        raise ScenarioError(
            [
                (
                    "",
                    f"{visible(text, LONGEST)!r} is not a setting: write PATH=VALUE, as in controller.feedback_gain=400.",
                )
            ]
        )
    return path, parse_value(value, path)


def parse_value(text: str, path: str) -> Any:
    """The value of a field as typed: JSON (numbers, lists, true, null), or else the text itself.

    Raises `ScenarioError` for JSON that names a field twice.
    """
    try:
        return json.loads(text, object_pairs_hook=unique_fields)
    except DuplicateField as error:
        raise ScenarioError([(path, f"{visible(path, LONGEST)} = {visible(text, LONGEST)}: {error}.")]) from None
    except (ValueError, RecursionError):
        return text


def settings_from(texts: Sequence[str] = (), law: str | None = None, seed: int | None = None) -> dict[str, Any]:
    """Typed settings as changes by path for `change_settings`. Raises `ScenarioError`."""
    changes = {path: value for path, value in ((LAW, law), (SEED, seed)) if value is not None}
    for text in texts:
        path, value = parse_setting(text)
        if path in changes:
            raise ScenarioError([(path, f"{visible(path, LONGEST)} is set twice: give it one value.")])
        changes[path] = value
    return changes


def change_settings(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """A copy with fields changed by path, kinds first and outer ones before inner, so that they may be named in any order.

    Raises `ScenarioError`.
    """
    ordered = sorted(changes.items(), key=lambda item: (not item[0].endswith(".kind"), item[0].count(".")))
    return scenario.replace(dict(ordered))


def with_period_if_needed(scenario: Scenario, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The changes, with a control period of `USUAL_PERIOD` if the scenario has none and they are valid only with one."""
    wanted = dict(changes)
    if scenario.controller.control_period is not None or PERIOD in wanted:
        return wanted
    for tried in (wanted, {**wanted, PERIOD: USUAL_PERIOD}):
        with suppress(ScenarioError):
            change_settings(scenario, tried)
            return tried
    return wanted
