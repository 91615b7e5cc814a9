"""Scenarios of earlier versions, in files and recordings, with their former meaning.

Until 0.1 there was `controller.model.bending_stiffness_factor`, which no law ever used, and `sensor_noise.strain` was a number in
1/s that entered hᵀq̇ and gᵀq̇ as σ m and σ m L, unlike any strain. Everything written by such a version names the first field, by
which it is recognised.
"""

import logging
from collections.abc import Mapping
from typing import Any

from flexlab.scenario.payload import Payload

RETIRED = "bending_stiffness_factor"
ONLY_PATH = "sine"
"""The kind of a path that names none: there was only this one."""

log = logging.getLogger(__name__)


def in_present_terms(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Plain data of a scenario with the present fields; logs what was set and is left out."""
    path = data.get("trajectory")
    if isinstance(path, Mapping) and "kind" not in path:
        data = {**data, "trajectory": {"kind": ONLY_PATH, **path}}
    law = data.get("controller")
    model = law.get("model") if isinstance(law, Mapping) else None
    if not isinstance(law, Mapping) or not isinstance(model, Mapping) or RETIRED not in model:
        return data
    if model[RETIRED] != 1:
        log.warning(
            "controller.model.%s = %r is left out: no control law asks for the believed stiffness, so that it never had "
            "an effect.",
            RETIRED,
            model[RETIRED],
        )
    present = {name: value for name, value in model.items() if name != RETIRED}
    return {**data, "controller": {**law, "model": present, **_noise(law.get("sensor_noise"), data.get("payload"))}}


def _noise(noise: Any, payload: Any) -> dict[str, Any]:
    """Strain in 1/s as the noise of hᵀq̇ and gᵀq̇ that it was. Invalid values stay, and validation names them."""
    if not isinstance(noise, Mapping) or "moment_rate" in noise or not noise.get("strain"):
        return {}
    payload = payload if isinstance(payload, Mapping) else {}
    density, length, strain = (
        payload.get("linear_density", Payload().linear_density),
        payload.get("length", Payload().length),
        noise["strain"],
    )
    if not all(isinstance(value, (int, float)) for value in (density, length, strain)):
        return {}
    mass = density * length
    return {"sensor_noise": {**noise, "strain": 0.0, "moment_rate": (strain * mass, strain * (mass * length))}}
