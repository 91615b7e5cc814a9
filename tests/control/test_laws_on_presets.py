"""Every law's default gains on every preset, and what all laws share: load share and wanted internal force."""

import numpy as np
import pytest

from flexlab.analysis.law_conditions import law_conditions
from flexlab.cli.headless_run import explained
from flexlab.control.law import laws
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset, preset_names
from flexlab.sim.simulate import simulate

DRIVING = [kind for kind, law in laws().items() if law.drives]


SAMPLED_ONLY = {"lqr"}
"""Laws that need a control period."""
BEYOND = {("lqr", "spin-up")}
"""A linear regulator is made for one pose; this path turns the beam, and with it the beam's pull on the arm, eleven times."""


@pytest.mark.parametrize("preset", preset_names())
def test_default_gains_run_every_preset_for_two_seconds(preset: str):
    for kind in DRIVING:
        if (kind, preset) in BEYOND:
            continue
        clock = {"controller.control_period": 0.001} if kind in SAMPLED_ONLY else {}
        run = simulate(load_preset(preset).replace({"controller.kind": kind, **clock}), 2.0)
        assert run.status == "finished", (kind, run.status.text)


@pytest.mark.parametrize("preset", preset_names())
def test_the_linear_regulator_says_for_which_paths_it_is_not_made(preset: str):
    """It says so before the run, below its gains, and the explanations of a run repeat it."""
    scenario = load_preset(preset).replace({"controller.kind": "lqr", "controller.control_period": 0.001})
    said = law_conditions(scenario)[0]
    assert said.sentence.startswith("|λ(Φ − ΓK)| < 1 on the path: the law is made for one pose, ")
    assert said.met == (("lqr", preset) not in BEYOND)
    if not said.met:
        assert said.sentence.endswith("1/s: take a path that turns less, or a law that follows the pose.")
        run = simulate(scenario, 2.0)
        assert run.status == "diverged"
        assert said.sentence in " ".join(explained(run, scenario))


@pytest.mark.parametrize("turns", [0.0, 0.5])
def test_a_linear_regulator_holds_a_beam_at_the_pose_that_it_is_made_for_and_not_half_a_turn_away(turns: float):
    path = load_preset("spin-up").trajectory
    first, last = path.rows[0], (path.rows[-1][0], *path.rows[0][1:3], 4 * np.pi * (3 + turns))
    changes = {"trajectory.rows": (first, last), "controller": {"kind": "lqr", "control_period": 0.001}}
    scenario = load_preset("spin-up").replace(changes)
    run = simulate(scenario, 0.2)
    assert run.status == ("finished" if turns == 0 else "diverged"), run.status.text


@pytest.mark.parametrize("kind", DRIVING)
@pytest.mark.parametrize("period", [None, 0.001])
def test_a_wanted_internal_force_is_applied_and_moves_nothing(kind: str, period: float | None):
    """F_d acts along the virtual link, squeeze positive, on top of the law's own force; held torques turn with the pose."""
    if period is None and kind in SAMPLED_ONLY:
        period = 0.001
    changes = {"controller.kind": kind, "controller.control_period": period}
    plain = simulate(load_preset("paper").replace(changes), 0.2)
    squeezed = simulate(load_preset("paper").replace(changes | {"controller.wanted_internal_force": 40.0}), 0.2)
    angle = plain.pose[:, 2]
    wanted = 40.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    added = squeezed.internal_force - plain.internal_force
    tolerance = 1e-6 if period is None else 2.0
    np.testing.assert_allclose(added[1:, 0], wanted[1:], rtol=0, atol=tolerance)
    np.testing.assert_allclose(added[1:, 1], -wanted[1:], rtol=0, atol=tolerance)
    np.testing.assert_allclose(squeezed.pose, plain.pose, rtol=0, atol=1e-10 if period is None else 1e-4)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_load_share_divides_the_torques_and_not_the_motion(share: float):
    """The payload moves the same; what the arms give beyond their own dynamics is divided as α : (1 - α)."""
    changes = {"controller.kind": "sliding-mode", "gravity": 9.81}
    halves = simulate(load_preset("paper").replace(changes), 0.2)
    run = simulate(load_preset("paper").replace(changes | {"controller.load_share": share}), 0.2)
    np.testing.assert_allclose(run.pose, halves.pose, rtol=0, atol=1e-12)
    total = 2 * (run.arm_input[:, 0] - halves.arm_input[:, 0]) / (2 * share - 1)
    np.testing.assert_allclose(run.arm_input.sum(axis=1), halves.arm_input.sum(axis=1), rtol=0, atol=1e-8)
    again = simulate(load_preset("paper").replace(changes | {"controller.load_share": 0.9}), 0.2)
    np.testing.assert_allclose(total, 2 * (again.arm_input[:, 0] - halves.arm_input[:, 0]) / 0.8, rtol=0, atol=1e-7)


def test_one_arm_carries_everything_whatever_the_share():
    one, other = (
        simulate(load_preset("single-arm").replace({"controller.load_share": share}), 0.1) for share in (0.5, 0.9)
    )
    assert one.pose.tobytes() == other.pose.tobytes()


def test_leakage_lets_the_bound_estimates_fade():
    """ḃ = … - σ b̂: with the payload at rest on its target b̂ falls as e^{-σt}; without leakage it never falls."""
    changes = {
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "initial.pose": (0.02, 0.75, 0.0),
        "controller.adaptation": (0.1,) * 3,
    }
    kept, faded = (
        simulate(load_preset("paper").replace(changes | {"controller.leakage": rate}), 3.0) for rate in (0.0, 2.0)
    )
    assert np.all(np.diff(kept.bound_estimates[:, 0]) >= 0)
    np.testing.assert_allclose(faded.bound_estimates[-1, 0] / faded.bound_estimates[1500, 0], np.exp(-3.0), rtol=1e-3)


def test_shares_and_forces_out_of_range_are_refused():
    with pytest.raises(ScenarioError, match=r"controller\.load_share = 1\.2 is outside .* 0 to 1"):
        load_preset("paper").replace({"controller.load_share": 1.2})
    with pytest.raises(ScenarioError, match=r"controller\.wanted_internal_force = 1000000 N"):
        load_preset("paper").replace({"controller.wanted_internal_force": 1e6})
