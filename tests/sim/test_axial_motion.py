"""Runs of beams that feel the force along them: energy, poles, commands, same bits and warnings."""

import numpy as np
import pytest

from flexlab.analysis.modes import modes
from flexlab.physics.axial_load import buckling_load
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

FELT = {"payload.axial_load": "first-order"}
HELD = {"trajectory.amplitude": (0.0, 0.0, 0.0), "initial.pose_rate": (0.0, 0.0, 0.0)}
SQUEEZED = {**FELT, **HELD, "controller.wanted_internal_force": 30.0}
INTEGRATORS = ("rk4", "etdrk4", "generalized-alpha")
P_CR = buckling_load(0.5, 1.27, "pinned-pinned")


def soft(changes: dict) -> Scenario:
    return load_preset("soft-beam").replace(changes)


def imbalance(run: Run) -> float:
    """Error of the energy balance, relative to the energy moved."""
    gained = run.total_energy - run.total_energy[0]
    work = run.input_work + run.axial_work - run.dissipated_energy
    moved = (
        np.abs(np.diff(run.input_work)).sum() + np.ptp(run.dissipated_energy) + np.abs(np.diff(run.axial_work)).sum()
    )
    return float(np.abs(gained - (work - work[0])).max() / moved)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("force", [-40.0, 30.0])
def test_energy_is_balanced_with_the_work_of_the_axial_load(integrator: str, force: float) -> None:
    run = simulate(soft({**FELT, "controller.wanted_internal_force": force, "simulation.integrator": integrator}), 1.0)
    assert not run.status.failed
    assert imbalance(run) < 1e-6
    assert np.ptp(run.axial_work) > 1e-3


def test_integrators_agree_on_a_squeezed_beam() -> None:
    squeezed = soft({**FELT, "controller.wanted_internal_force": 30.0})
    ends = [simulate(squeezed.replace({"simulation.integrator": name}), 0.5) for name in INTEGRATORS]
    for run in ends[1:]:
        np.testing.assert_allclose(run.midspan_deflection, ends[0].midspan_deflection, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.axial_work, ends[0].axial_work, rtol=0, atol=1e-6)


def test_with_one_arm_the_axial_load_accelerates_the_mass_beyond_it() -> None:
    """N'(s) = -ρ a(s): the force at a place is the mass beyond that place times its acceleration."""
    run = simulate(load_preset("single-arm").replace(FELT), 0.3)
    payload = run.scenario.payload
    inner, outer = (payload.length / 4 * (1 + side * 3**-0.5) for side in (-1, 1))
    place = np.array([-outer, -inner, inner, outer])
    beyond, middle = payload.length / 2 - place, (payload.length / 2 + place) / 2
    e1 = np.stack([np.cos(run.pose[:, 2]), np.sin(run.pose[:, 2])], axis=1)
    inward = np.sum(e1 * run.pose_acceleration[:, :2], axis=1)[:, None] - run.pose_rate[:, 2:] ** 2 * middle
    np.testing.assert_allclose(run.axial_load, -payload.linear_density * beyond * inward, rtol=0, atol=1e-10)
    assert np.all(run.axial_load_share >= 0)


def test_the_axial_load_of_a_steady_squeeze_is_the_wanted_force() -> None:
    run = simulate(soft(SQUEEZED), 3.0)
    np.testing.assert_allclose(run.axial_load[-1], -30.0, atol=1e-3)
    assert run.axial_load_share[-1] == pytest.approx(30 / P_CR, rel=1e-3)


@pytest.mark.parametrize("force", [-40.0, 20.0, 40.0])
def test_the_free_ring_of_a_squeezed_or_stretched_beam_has_the_frequency_of_its_pole(force: float) -> None:
    """Its frequency also follows √(1 - P/P_cr), except that even these heavy arms give way a little."""
    heavy = {"left_arm.link_mass": (80, 80, 40), "right_arm.link_mass": (80, 80, 40), "payload.element_count": 4}
    damped = {"controller.feedback_gain": 5e3, "payload.damping.coefficient": 0.01}
    scenario = soft({**SQUEEZED, **heavy, **damped, "controller.wanted_internal_force": force})
    run = simulate(scenario, 4.0, 0.001, ((1.0, Tap(0.0, (0.0, 0.002))),))
    ring = run.take(run.time > 1.0)
    w = ring.midspan_deflection
    upwards = np.flatnonzero(np.diff(np.sign(w)) > 0)
    first, last = (float(ring.time[k] - w[k] * 0.001 / (w[k + 1] - w[k])) for k in (upwards[0], upwards[-1]))
    found = (len(upwards) - 1) / (last - first)
    linear = modes(scenario)
    pairs = zip(linear.poles, linear.pole_origin, strict=True)
    own = [abs(pole.imag) / (2 * np.pi) for pole, origin in pairs if origin == "beam mode 1"]
    assert found == pytest.approx(own[0], rel=2e-4)
    assert found == pytest.approx(linear.frequency[0] * np.sqrt(1 - force / P_CR), rel=4e-3)


def test_a_pull_along_the_beam_loads_it_only_as_far_as_the_hand() -> None:
    """Pulled away from an arm that hardly moves, the beam is in tension up to the hand and bears nothing beyond it."""
    one = load_preset("single-arm").replace({**FELT, **HELD})
    world = World(one)
    x, y, _ = one.trajectory.middle
    world.apply(Pull(0.1, (x + 0.6, y), 50.0))
    run = world.run(2000)
    load, hand = run.axial_load[-1], 50.0 * (0.5 - (run.pose[-1, 0] - x))
    assert load[3] == pytest.approx(0, abs=0.05)
    np.testing.assert_allclose(load[:3], hand, atol=0.1)


@pytest.mark.parametrize(
    ("preset", "bent"), [("soft-beam", (0.02, 0.003, 0.0, -0.02)), ("single-arm", (0.003, 0.02, 0.01, 0.03))]
)
def test_a_tap_is_the_limit_of_a_short_strong_pull(preset: str, bent: tuple[float, ...]) -> None:
    """A bent beam that is hit along its axis turns because of the force that it feels during the blow."""
    still = {**HELD, "initial.beam_coordinates": bent, "payload.damping.coefficient": 0.0, "controller.kind": "none"}
    scenario = load_preset(preset).replace(FELT | still)
    felt, unfelt = World(scenario), World(scenario.replace({"payload.axial_load": "none"}))
    before = felt.observe()
    for world in (felt, unfelt):
        world.apply(Tap(0.05, (0.2, 0.0)))
    tapped = felt.observe()
    effect = np.abs(tapped.beam_rates - unfelt.observe().beam_rates).max()
    assert effect > 0.1
    # Pull for 10 µs by a spring so soft that its force is constant.
    short, distance, (x, y, _) = 1e-6, 90.0, before.pose[0].tolist()
    pulled, free = (World(scenario.replace({"simulation.step": short}), short) for _ in range(2))
    pulled.apply(Pull(0.05, (x + distance, y), 0.2 / (10 * short) / distance))
    end, without = pulled.run(10), free.run(10)
    for name, atol in (("pose_rate", 1e-4), ("beam_rates", 0.01 * effect)):
        gained = end[name][-1] - without[name][-1]
        np.testing.assert_allclose(gained, tapped[name][0] - before[name][0], rtol=0, atol=atol)


COMMANDS = (
    (0.1, Tap(0.05, (0.05, 0.02))),
    (0.2, Pull(0.1, (0.2, 0.9), 40.0)),
    (0.3, ChangeScenario({"controller.wanted_internal_force": 20.0})),
    (0.35, Pull(0.0, (0.0, 0.0), 0.0)),
    (0.4, ChangeScenario({"payload.axial_load": "none"})),
    (0.45, ChangeScenario({"payload.axial_load": "first-order"})),
)


def test_block_sizes_change_no_bit() -> None:
    sampled = {"controller.control_period": 0.002, "controller.input_delay": 1}
    whole = simulate(soft({**FELT, **sampled}), 0.6, 0.001, COMMANDS)
    world, parts = World(soft({**FELT, **sampled})), []
    ends = [100, 137, 200, 300, 333, 350, 400, 450, 600]
    due = {round(1000 * t): command for t, command in COMMANDS}
    for end in ends:
        part = world.advance(end - world.tick)
        parts.append(part.pose)
        if end in due:
            world.apply(due[end])
    np.testing.assert_array_equal(np.concatenate(parts), whole.pose[1:])


def test_the_papers_beam_hardly_feels_the_axial_load() -> None:
    """The deflection changes by under 1 % at its peak and in steady motion; the ring in between drifts in phase by 0.4 %."""
    paper, felt = (simulate(load_preset("paper").replace(c), 2.0).midspan_deflection for c in ({}, FELT))
    assert np.abs(felt).max() == pytest.approx(np.abs(paper).max(), rel=0.01)
    assert not np.array_equal(paper, felt)
    assert np.abs(paper - felt)[1000:].max() < 0.01 * np.abs(paper[1000:]).max()


def test_a_beam_squeezed_beyond_its_buckling_load_buckles_and_the_run_says_so() -> None:
    beyond = {**SQUEEZED, "controller.wanted_internal_force": 60.0, "initial.beam_coordinates": (0.0, 1e-5, 0.0, 0.0)}
    run = simulate(soft(beyond), 10.0)
    assert "it buckles" in run.status.text
    assert np.abs(run.midspan_deflection[-1]) > 0.05
    calm = simulate(soft({**beyond, "payload.axial_load": "none"}), 2.0)
    assert "a real beam would have buckled" in calm.status.text
    assert np.abs(calm.midspan_deflection).max() < 1e-3


def test_warnings_begin_at_10_percent_of_the_buckling_load_and_change_at_100() -> None:
    said = [simulate(soft({**HELD, "controller.wanted_internal_force": f}), 0.3).status.text for f in (4.0, 10.0, 60.0)]
    assert "along it" not in said[0]
    assert "% of its buckling load: the paper's model leaves out" in said[1]
    assert "more than its buckling load of 50.1 N: a real beam would" in said[2]


def test_a_run_that_spin_makes_diverge_names_the_spin() -> None:
    run = simulate(load_preset("spin-up").replace({"payload.axial_load": "none"}), 3.0, 0.01)
    assert run.status == "diverged"
    assert "exceeded the beam's length" in run.status.text
    assert "the link spun faster than the beam's first mode rings" in run.status.text


@pytest.mark.parametrize(
    ("share", "said"), [(0.07, "Large deflection: |w|/L was up to 7 %, at t = 0.000 s, above 5 %."), (0.045, "")]
)
def test_a_large_deflection_is_reported_wherever_on_the_beam_it_is(share: float, said: str):
    """A cantilever bent like a parabola: its middle is a quarter as far from the axis as its free end."""
    length = load_preset("single-arm").payload.length
    shape = [(share * s**2 * length, 2 * share * s) for s in (0.5, 1.0)]
    bent = {"payload.element_count": 2, "initial.beam_coordinates": [value for node in shape for value in node]}
    at_rest = {"trajectory.amplitude": (0.0, 0.0, 0.0), "initial.pose_rate": None}
    run = simulate(load_preset("single-arm").replace(bent | at_rest), 0.05)
    assert str(run.status) == "finished"
    assert said in run.status.text
    assert ("Large deflection" in run.status.text) is bool(said)
