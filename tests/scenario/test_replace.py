"""Changes by path: validating only the parts that they touch gives the same outcome as validating the whole scenario."""

from collections.abc import Mapping
from typing import Any

import pytest

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario

PAPER = load_preset("paper")
BENT = PAPER.replace({"initial.beam_coordinates": (0.001, 0.0, 0.001, 0.0)})
SAMPLED = PAPER.replace({"controller.control_period": 0.001, "controller.input_delay": 1})

CHANGES: list[tuple[Scenario, Mapping[str, Any]]] = [
    (PAPER, {"controller.feedback_gain": 210}),
    (PAPER, {"controller.feedback_gain": (1.0, 2.0, 3.0), "payload.bending_stiffness": 90.0, "gravity": 1.0}),
    (PAPER, {"controller.feedback_gain": "much"}),
    (PAPER, {"controller.feedback_gain": float("nan")}),
    (PAPER, {"payload.bending_stiffness": -1.0, "payload.length": 1e9}),
    (PAPER, {"payload.damping.coefficient": 0.2}),
    (PAPER, {"payload.damping.coefficient": -0.2}),
    (PAPER, {"payload.damping.kind": "modal"}),
    (PAPER, {"payload.damping.kind": "modal", "payload.damping.ratio": 0.1}),
    (PAPER, {"payload.damping": {"kind": "stiffness", "coefficient": 1e-3}}),
    (PAPER, {"payload.damping": None, "payload.damping.coefficient": 0.2}),
    (PAPER, {"payload.damping.": 0.2}),
    (PAPER, {"payload.": 0.2}),
    (PAPER, {"payload.nothing": 0.2}),
    (PAPER, {"payload.length.nothing": 0.2}),
    (PAPER, {"nothing.at_all": 0.2}),
    (PAPER, {"payload": {"length": 0.6}, "payload.linear_density": 3.0}),
    (PAPER, {"payload.boundary": "clamped-free"}),
    (PAPER, {"payload.boundary": "clamped-free", "right_arm": None}),
    (PAPER, {"controller.kind": "pd"}),
    (PAPER, {"controller.model.length_factor": 1.1, "controller.sensor_noise.strain": 1e-6}),
    (PAPER, {"controller.model.bending_stiffness_factor": 2.0}),
    (PAPER, {"trajectory.amplitude": (0.1, 0.1, 0.1), "trajectory.smooth_start": 0.5}),
    (PAPER, {"right_arm.link_mass": (0.0, 0.0, 0.0)}),
    (BENT, {"payload.element_count": 3}),
    (BENT, {"payload.bending_stiffness": 3.0}),
    (SAMPLED, {"controller.control_period": None}),
    (SAMPLED, {"controller.control_period": 0.002}),
]


def outcome(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario | str:
    """The changed scenario, or the reason why it is refused."""
    try:
        return scenario.replace(changes)
    except ScenarioError as error:
        return str(error)


@pytest.mark.parametrize(("scenario", "changes"), CHANGES)
def test_validating_only_the_changed_parts_gives_the_outcome_of_the_whole(
    scenario: Scenario, changes: Mapping[str, Any], monkeypatch: pytest.MonkeyPatch
):
    given = dict(changes)
    by_parts = outcome(scenario, changes)
    monkeypatch.setattr(Scenario, "_with_parts", lambda *_: None)
    whole = outcome(scenario, changes)
    assert by_parts == whole
    assert changes == given
    if isinstance(by_parts, Scenario) and isinstance(whole, Scenario):
        assert by_parts.model_dump_json() == whole.model_dump_json()
