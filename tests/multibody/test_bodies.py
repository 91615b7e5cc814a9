"""Exported bodies in independent readers: Pinocchio reads URDF, MuJoCo also MJCF; arms are exact, beams nearly so."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from reference.pinocchio_arms import pinocchio_arms
from reference.terms import random_scenario
from scipy.linalg import eigh, null_space

from flexlab.errors import ScenarioError, StudyError
from flexlab.multibody import write_bodies
from flexlab.multibody.bodies import make_bodies
from flexlab.multibody.formats import mjcf_text
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.sim.simulate import simulate

ROUNDING = 1e-12
MESH = {"payload.element_count": 8}
BOUNDARIES = {
    "pinned-pinned": (MESH, 1e-4),
    "clamped-pinned": (MESH, 0.007),
    "pinned-clamped": (MESH, 0.007),
    "clamped-clamped": (MESH, 0.016),
    "clamped-free": (MESH | {"right_arm": None}, 0.0025),
}
"""Boundary → changes with a mesh as good as exact, and the largest relative error of the chain's first frequency."""


def loaded(scenario: Scenario) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return MuJoCo's model and its state at the start."""
    model = mujoco.MjModel.from_xml_string(mjcf_text(make_bodies(scenario), "test"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("seed", range(3))
def test_exported_arms_are_those_of_flexlab(seed: int, tmp_path: Path):
    """Random arms keep masses, lengths, kinematics, mass matrix and weight in Pinocchio; kinematics and mass matrix in MuJoCo."""
    scenario = random_scenario(seed)
    model = pin.buildModelFromUrdf(str(write_bodies(scenario, tmp_path / "arms.urdf")))
    data, rng = model.createData(), np.random.default_rng(seed)
    other, state = loaded(scenario)
    dense = np.zeros((other.nv, other.nv))
    for name, arm, ours in zip(("left", "right"), scenario.arms, pinocchio_arms(scenario), strict=True):
        joints = [model.getJointId(f"{name}_joint_{k}") for k in (1, 2, 3)]
        links = [model.inertias[joint] for joint in joints]
        # These are the links alone: in the URDF the beam hangs on joints of its own.
        assert [link.mass for link in links] == pytest.approx(arm.link_mass, rel=ROUNDING)
        assert [link.lever[0] for link in links] == pytest.approx(arm.link_center, rel=ROUNDING)
        assert [link.inertia[2, 2] for link in links] == pytest.approx(arm.inertia, rel=ROUNDING)
        lengths = [model.jointPlacements[joint].translation[0] for joint in joints[1:]]
        assert lengths == pytest.approx(arm.link_length[:2], rel=ROUNDING)
        q, grip = pin.neutral(model), model.getFrameId(f"{name}_grip")
        angles = rng.uniform(-2, 2, 3)
        for joint, angle in zip(joints, angles, strict=True):
            q[model.joints[joint].idx_q] = angle
            state.joint(f"{name}_joint_{joint - joints[0] + 1}").qpos[0] = angle
        pin.framesForwardKinematics(model, data, q)
        pin.framesForwardKinematics(ours.model, ours.data, angles)
        wanted = ours.data.oMf[ours.grip].translation[:2]
        # The plane of motion is vertical in a scenario with weight.
        np.testing.assert_allclose(data.oMf[grip].translation[[0, 2]], wanted, rtol=0, atol=ROUNDING)
        mujoco.mj_forward(other, state)
        np.testing.assert_allclose(state.site(f"{name}_grip").xpos[[0, 2]], wanted, rtol=0, atol=ROUNDING)
        if name == "right":  # In a tree, it carries nothing.
            own = slice(model.joints[joints[0]].idx_v, model.joints[joints[-1]].idx_v + 1)
            wanted = pin.crba(ours.model, ours.data, angles)
            wanted = np.triu(wanted) + np.triu(wanted, 1).T
            found = np.triu(pin.crba(model, data, q)[own, own])
            np.testing.assert_allclose(found + np.triu(found, 1).T, wanted, rtol=ROUNDING, atol=ROUNDING)
            mujoco.mj_fullM(other, state, dense)
            own = [other.joint(f"right_joint_{k}").dofadr[0] for k in (1, 2, 3)]
            np.testing.assert_allclose(dense[np.ix_(own, own)], wanted, rtol=ROUNDING, atol=ROUNDING)
            weight = pin.computeGeneralizedGravity(ours.model, ours.data, angles)
            rest = pin.computeGeneralizedGravity(model, data, q)
            there = slice(model.joints[joints[0]].idx_v, model.joints[joints[-1]].idx_v + 1)
            np.testing.assert_allclose(rest[there], weight, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_exported_beam_has_nearly_the_first_frequency_of_the_finite_elements(boundary: str):
    """MuJoCo's masses, springs and loops, with the arms held, also have the first frequency that the file states."""
    changes, error = BOUNDARIES[boundary]
    scenario = Scenario().replace({"payload.boundary": boundary, **changes})
    bodies = make_bodies(scenario)
    assert abs(bodies.frequency / bodies.beam_frequency - 1) < error
    model, data = loaded(scenario)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    beam = [k for k in range(model.nv) if model.joint(model.dof_jntid[k]).name.startswith("beam_")]
    loops = data.efc_J.reshape(-1, model.nv)[:, beam]
    free = null_space(loops) if len(loops) else np.eye(len(beam))
    springs = np.diag(model.jnt_stiffness[model.dof_jntid[beam]].ravel())
    squares = eigh(free.T @ springs @ free, free.T @ mass[np.ix_(beam, beam)] @ free, eigvals_only=True)
    assert np.sqrt(squares[0]) / (2 * np.pi) == pytest.approx(bodies.frequency, rel=1e-6)
    assert f"is {bodies.frequency:.5g} Hz" in bodies.about()


def fallen(scenario: Scenario, step: float) -> np.ndarray:
    """Position of the payload's origin in MuJoCo after 0.1 s in steps of `step` s, m (2,)."""
    model, data = loaded(scenario)
    model.opt.timestep = step
    for _ in range(round(0.1 / step)):
        mujoco.mj_step(model, data)
    along = data.site("left_grip").xmat.reshape(3, 3)[:, 0]
    return (data.site("left_grip").xpos + scenario.payload.length / 2 * along)[[0, 2]]


@pytest.mark.parametrize(
    ("boundary", "gravity", "near"),
    [("pinned-pinned", 9.81, 1e-8), ("clamped-free", 9.81, 5e-6), ("pinned-pinned", -9.81, 1e-8)],
)
def test_the_payload_falls_in_mujoco_as_in_flexlab(boundary: str, gravity: float, near: float):
    """After 0.1 s (5 cm) both are at the same place, as far as their beams bend alike: links and loops are right.

    Negative gravity, which pulls upwards, used to have no effect.
    """
    changes = BOUNDARIES[boundary][0] | {"payload.boundary": boundary, "controller.kind": "none", "gravity": gravity}
    scenario = Scenario().replace(changes)
    run = simulate(scenario, 0.1)
    # MuJoCo's method is of first order, so two step sizes give its error.
    found = 2 * fallen(scenario, 1e-5) - fallen(scenario, 2e-5)
    assert np.sign(gravity) * (run.pose[0, 1] - run.pose[-1, 1]) > 0.04
    np.testing.assert_allclose(found, run.pose[-1, :2], rtol=0, atol=near)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_opens_with_closed_loops_and_matching_speeds(name: str, tmp_path: Path):
    scenario = load_preset(name)
    model, data = loaded(scenario)
    assert model.neq > 0 or len(scenario.arms) == 1
    assert np.abs(data.efc_pos).max(initial=0) < ROUNDING
    assert np.abs(data.efc_vel).max(initial=0) < ROUNDING
    assert model.nu == 3 * len(scenario.arms)
    file = write_bodies(scenario, tmp_path / "it.urdf", name)
    assert pin.buildModelFromUrdf(str(file)).nq == mujoco.MjModel.from_xml_path(str(file)).nq


def test_the_loops_are_closed_at_a_bent_and_moving_start():
    _, data = loaded(load_preset("smooth-start").replace({"initial.beam_coordinates": [0.05, 0.002, 0.01, -0.05]}))
    assert np.abs(data.qvel).max() > 0.1
    assert data.joint("beam_slide").qpos > 1e-6
    assert np.abs(data.efc_pos).max() < ROUNDING
    assert np.abs(data.efc_vel).max() < ROUNDING


def test_a_link_without_mass_is_refused_by_name():
    scenario = Scenario().replace({"right_arm.link_mass": [8.0, 0.0, 4.0], "right_arm.link_inertia": [1.0, 0.1, 1.0]})
    with pytest.raises(
        StudyError, match=r"^right link 2 has the mass 0 kg and the inertia 0\.1 kg·m²: MuJoCo requires both"
    ):
        mjcf_text(make_bodies(scenario), "test")


@pytest.mark.parametrize("changes", [{"initial.pose": (0.0, 5.0, 0.0)}, {"trajectory.center": (0.0, 3.0, 0.0)}])
def test_a_scenario_that_cannot_start_is_refused_with_the_reason(changes: dict[str, object], tmp_path: Path):
    """It ended with "Singular matrix"."""
    with pytest.raises(ScenarioError, match=r"^The left arm cannot reach the (start|desired) pose"):
        write_bodies(Scenario().replace(changes), tmp_path / "arms.urdf")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ["urdf", "xml"])
def test_a_beam_that_is_too_steep_at_the_start_is_refused(ending: str, tmp_path: Path):
    """The angles of its pieces were written as nan."""
    steep = load_preset("paper").replace({"initial.beam_coordinates": [4.0, 0.0, 0.0, -4.0]})
    with pytest.raises(ScenarioError, match=r"^initial.beam_coordinates: a slope of 3.24 to the chord is too steep"):
        write_bodies(steep, tmp_path / f"a.{ending}")
    assert not list(tmp_path.iterdir())


def test_the_friction_of_the_joints_is_exported(tmp_path: Path):
    viscous, coulomb = (5.0, 4.0, 2.0), (8.0, 6.0, 3.0)
    friction = {"joints.friction.viscous": viscous, "joints.friction.coulomb": coulomb}
    scenario = load_preset("paper").replace(friction)
    robot = ElementTree.parse(write_bodies(scenario, tmp_path / "arms.urdf")).getroot()
    model, _ = loaded(scenario)
    for name in ("left", "right"):
        for k in range(3):
            dof = model.joint(f"{name}_joint_{k + 1}").dofadr[0]
            assert (model.dof_damping[dof], model.dof_frictionloss[dof]) == (viscous[k], coulomb[k])
            told = robot.find(f"joint[@name='{name}_joint_{k + 1}']/dynamics")
            assert told is not None
            assert (float(told.attrib["damping"]), float(told.attrib["friction"])) == (viscous[k], coulomb[k])
