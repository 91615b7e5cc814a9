"""Reads scenarios of earlier versions, in files and recordings, with their former meaning.

Until 0.1 there was `controller.model.bending_stiffness_factor`, which no law ever used, and `sensor_noise.strain` was a number in
1/s that entered hᵀq̇ and gᵀq̇ as σ m and σ m L, unlike any strain. Everything written by such a version names the first field, by
which it is recognised.
"""

import logging
from collections.abc import Mapping
from typing import Any, cast

from flexlab.scenario.payload import Payload

RETIRED = "bending_stiffness_factor"
ONLY_PATH = "sine"
"""The kind of a path that names none: there was only this one."""
log = logging.getLogger(__name__)


def in_present_terms(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """A scenario's plain data with the present fields; logs a setting that is left out."""
    path, law = _part(data, "trajectory"), _part(data, "controller")
    if path is not None and "kind" not in path:
        data = {**data, "trajectory": {"kind": ONLY_PATH, **path}}
    model = _part(law or {}, "model")
    if law is None or model is None or RETIRED not in model:
        return data
    if model[RETIRED] != 1:
        log.warning(
            "controller.model.%s = %r is left out: no control law asks for the believed stiffness, so that it never had "
            "an effect.",
            RETIRED,
            model[RETIRED],
        )
    present = {name: value for name, value in model.items() if name != RETIRED}
    return {
        **data,
        "controller": {**law, "model": present, **_noise(_part(law, "sensor_noise"), _part(data, "payload") or {})},
    }


def _part(data: Mapping[str, Any], name: str) -> Mapping[str, Any] | None:
    """A part of plain data; None if it is not a mapping, which validation reports."""
    part = data.get(name)
    return cast("Mapping[str, Any]", part) if isinstance(part, Mapping) else None


def _noise(noise: Mapping[str, Any] | None, payload: Mapping[str, Any]) -> dict[str, Any]:
    """Former noise of strain, 1/s, as the noise of hᵀq̇ and gᵀq̇ that it was. Invalid values stay, and validation reports them."""
    if noise is None or "moment_rate" in noise or not noise.get("strain"):
        return {}
    density, length, strain = (
        payload.get("linear_density", Payload().linear_density),
        payload.get("length", Payload().length),
        noise["strain"],
    )
    if not all(isinstance(value, (int, float)) for value in (density, length, strain)):
        return {}
    mass = density * length
    return {"sensor_noise": {**noise, "strain": 0.0, "moment_rate": (strain * mass, strain * (mass * length))}}
