"""Other engines are given the same system, and reproduce its motion."""

import io
from contextlib import redirect_stdout

import numpy as np
import pytest
from peers import chain_comparison, peer_comparison
from peers.beam_comparison import BeamComparison, BeamRow
from peers.bodies import Motion, joint_torque_law, make_bodies
from peers.chain_comparison import (
    ChainComparison,
    ChainRow,
    chain_scenario,
    compare_chains,
    motion_errors,
)
from peers.peer_comparison import PeerComparison, PeerRow, Setting, compare_peers, row_of
from peers.tables import beam_table, chain_table, peers_table

from flexlab.physics.plant import make_workspace
from flexlab.presets import load_preset
from flexlab.sim.build import build_beam
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World
from flexlab.text import console

TICKS = 60
"""Length of the compared runs, ms: the jerk at the start, where engines differ most."""


def with_peers() -> None:
    """Skip a test if the extra `peers` is not installed: the engines take half a minute, and only `bench --peers` needs them."""
    for engine in ("mujoco", "exudyn"):
        pytest.importorskip(engine)


@pytest.fixture(scope="module")
def world() -> World:
    return World(load_preset("paper"))


@pytest.fixture(scope="module")
def exact():
    return simulate(load_preset("paper").replace({"simulation.step": 5e-5}), TICKS * 1e-3)


def test_the_bodies_have_the_payloads_mass_inertia_and_frequencies(world):
    bodies, payload = make_bodies(world.scenario), world.scenario.payload
    sliding = sum(mode.inertia for mode in bodies.modes if mode.slides)
    turning = sum(mode.inertia for mode in bodies.modes if not mode.slides)
    last_links = 2 * world.scenario.left_arm.link_mass[2]
    assert bodies.carrier.mass + sliding == pytest.approx(last_links + 1.0, rel=1e-12)
    offset = bodies.middle - world.scenario.left_arm.link_center[2]
    of_links = 2 * world.scenario.left_arm.inertia[2] + last_links * offset**2
    assert bodies.carrier.inertia + turning == pytest.approx(of_links + 2.0 * payload.length**3 / 12, rel=1e-12)
    omega = sorted(np.sqrt(mode.stiffness / mode.inertia) for mode in bodies.modes)
    assert omega == pytest.approx(sorted(build_beam(payload).modes.omega), rel=1e-12)


def test_the_bodies_have_the_papers_damping(world):
    bodies, beam = make_bodies(world.scenario), build_beam(world.scenario.payload)
    scale = np.array([mode.scale for mode in bodies.modes])
    damping = bodies.damping / np.outer(scale, scale)
    assert np.sort(np.linalg.eigvalsh(damping)) == pytest.approx(np.sort(np.linalg.eigvalsh(beam.modes.D)), rel=1e-9)


def test_the_law_for_other_engines_gives_the_torques_of_flexlab(world):
    sample, tau = simulate(world.scenario, 0.02), np.zeros((2, 3))
    k = len(sample) - 1
    workspace = make_workspace(2, len(world.beam.modes.omega))
    memory = sample.bound_estimates[k].copy()
    code = joint_torque_law(
        world.system, float(sample.time[k]), sample.pose[k].copy(), sample.pose_rate[k].copy(), memory, workspace, tau
    )
    assert code == 0
    assert tau == pytest.approx(sample.joint_torque[k], rel=1e-12)


def test_mujoco_reproduces_the_motion(world, exact):
    with_peers()
    from peers.mujoco_model import simulate_mujoco

    motion = simulate_mujoco(world, "rk4", 3, TICKS)
    assert np.max(np.abs(motion.pose - exact.pose[1:])) < 1e-8
    assert np.max(np.abs(motion.deflection - exact.midspan_deflection[1:])) < 1e-6
    assert motion.cpu > 0
    held = simulate_mujoco(world, "implicitfast", 20, TICKS)
    assert np.max(np.abs(held.pose - exact.pose[1:])) < 1e-4


def test_exudyn_reproduces_the_motion(world, exact):
    with_peers()
    from peers.exudyn_model import simulate_exudyn

    motion = simulate_exudyn(world, 3, TICKS, 1e-6)
    assert np.max(np.abs(motion.pose - exact.pose[1:])) < peer_comparison.SAME_POSE
    assert np.max(np.abs(motion.deflection - exact.midspan_deflection[1:])) < peer_comparison.SAME_DEFLECTION


def test_an_engine_with_a_different_motion_is_not_timed(world, exact):
    def simulate_late(world: World, ticks: int) -> Motion:
        return Motion(exact.pose[:-1], exact.midspan_deflection[:-1], 1e-9)

    row = row_of(Setting("late", "", 1, simulate_late), world, exact)
    assert not row.same_motion
    assert row.ms_per_second is None


def test_the_ratio_is_that_of_the_fastest_peer():
    own = PeerRow("flexlab", "", 1e-3, 1e-9, 1e-9, 2.0)
    rows = [PeerRow("a", "", 1e-3, 1e-9, 1e-9, 60.0), PeerRow("b", "", 1e-3, 1e-9, 1e-9, 30.0)]
    rows.append(PeerRow("c", "", 1e-3, 1e-3, 1e-9, None))
    assert PeerComparison(own, rows, {}).ratio == 15.0
    assert PeerComparison(own, [], {}).ratio is None


def test_a_peer_that_is_missing_or_fails_is_reported_with_the_reason(monkeypatch):
    def fail(world: World, ticks: int) -> Motion:
        raise RuntimeError("no license\ntrace")

    settings = [Setting("nosuchengine", "", 1, fail), Setting("json", "", 1, fail), Setting("json", "", 2, fail)]
    monkeypatch.setattr(peer_comparison, "peer_settings", lambda: settings)
    result = compare_peers(0.02)
    assert result.rows == []
    assert result.missing["json"] == "failed: no license"
    assert result.missing["nosuchengine"].startswith("not installed")
    assert result.own.same_motion


@pytest.mark.parametrize(("segments", "steps"), [(4, 1), (6, 3)])
def test_a_chain_in_mujoco_has_the_same_pose_and_the_known_error_in_deflection(segments: int, steps: int):
    with_peers()
    from peers.mujoco_model import simulate_chain

    # A tenth of the path's amplitude: the effect of inextensible rods grows with its square.
    small = {"trajectory.amplitude": (0.02, 0.02, 0.02)}
    exact = simulate(chain_scenario(8, 1e-3).replace(small), TICKS * 1e-3)
    motion = simulate_chain(World(chain_scenario(2, 1e-3).replace(small)), segments, "RK4", steps, TICKS)
    pose, deflection = motion_errors(motion, exact)
    assert pose < 1e-6
    # A polygon carries less load in its first mode than a half sine, by (π/N)²/12; its frequency is the same to order 4.
    largest = np.max(np.abs(exact.midspan_deflection))
    assert deflection / largest == pytest.approx((np.pi / segments) ** 2 / 12, rel=0.15)


def test_a_geometrically_exact_beam_agrees_to_first_order_in_the_deflection():
    """The difference relative to the deflection falls in proportion to the deflection."""
    pytest.importorskip("exudyn")
    from peers.beam_comparison import squeezed

    whole, half = squeezed(1, 0.3, 8, 1e-3), squeezed(2, 0.3, 8, 1e-3)
    assert whole.difference < 0.015
    assert whole.difference / half.difference == pytest.approx(2, rel=0.1)


def test_flexlabs_meshes_converge_and_are_compared_even_without_chains(monkeypatch):
    monkeypatch.setattr(chain_comparison, "find_spec", lambda name: None)
    monkeypatch.setattr(chain_comparison, "DURATION", 0.03)
    result = compare_chains()
    pose, deflection = [row.pose_error for row in result.own], [row.deflection_error for row in result.own]
    assert pose[0] > 5 * pose[1] > 25 * pose[2]
    assert deflection[0] > 5 * deflection[1] > 25 * deflection[2]
    assert (result.chains, result.equal, result.ratio) == ([], None, None)
    assert result.missing is not None


def test_the_cheapest_chain_of_the_same_accuracy_is_the_one_compared():
    own = ChainRow("flexlab", 2, "etdrk4", 1e-3, 4e-6, 2e-4, 5.0)
    coarse = ChainRow("MuJoCo", 2, "RK4", 1e-3, 8e-6, 8e-4, 30.0)
    equal = ChainRow("MuJoCo", 4, "RK4", 1e-3, 2e-6, 3e-4, 40.0)
    fine = ChainRow("MuJoCo", 8, "RK4", 1e-4, 2e-6, 6e-5, 400.0)
    result = ChainComparison([own], [coarse, fine, equal], None)
    assert result.equal is equal
    assert result.ratio == 8.0
    assert equal.environment_rate == pytest.approx(25_000)
    assert result.equal_in_both is fine
    assert "8.0 times the cost at the same pose error, 80.0 at" in str(chain_table(result).title)
    assert ChainComparison([own], [coarse], None).ratio is None


def test_tables_say_how_to_install_what_is_missing_and_fit_a_terminal(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "80")
    own = ChainRow("flexlab", 2, "etdrk4", 1e-3, 4e-6, 2e-4, 5.0)
    chain = ChainRow("MuJoCo", 32, "implicitfast", 2e-5, 1e-5, 7e-5, 12345.6)
    text = io.StringIO()
    with redirect_stdout(text):
        show = console()
        show.print(chain_table(ChainComparison([own], [chain], None)))
        show.print(chain_table(ChainComparison([own], [], "not installed: pip install 'flexlab[peers]'")))
        show.print(
            peers_table(PeerComparison(PeerRow("flexlab", "", 1e-3, 1e-9, 1e-9, 2.0), [], {"X": "flexlab[peers]"}))
        )
        show.print(beam_table(BeamComparison([BeamRow("squeeze-until-it-buckles", 5e-3, 0.0123)], None)))
        show.print(beam_table(BeamComparison([], "not installed: pip install 'flexlab[peers]'")))
    assert text.getvalue().count("[peers]") == 3
    assert "1.23" in text.getvalue()
    assert "…" not in text.getvalue()
    assert "implicitfast" in text.getvalue()
