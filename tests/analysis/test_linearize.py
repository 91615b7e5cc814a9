"""Linear models: against an independent linearisation, against the nonlinear run, and as other tools use them."""

import sys
from typing import Any

import numpy as np
import pytest
from reference.lagrangian import Lagrangian
from reference.linear import NEAR, hessian, open_loop_matrices
from scipy.signal import StateSpace, bode, cont2discrete, dbode, dfreqresp, dlsim, freqresp, lsim

import flexlab
from flexlab.analysis.linear_model import LinearModel
from flexlab.analysis.modes import modes
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.signals import TABLE
from flexlab.sim.simulate import simulate

SAMPLED = {"controller.control_period": 2e-3, "controller.input_delay": 2}
HELD_TORQUES = {"controller.control_period": 2e-3}


def still(name: str = "paper", **changes) -> Scenario:
    return load_preset(name).replace({"trajectory.amplitude": (0.0, 0.0, 0.0), **changes})


def joint_angles(lagrangian: Lagrangian, pose: np.ndarray) -> np.ndarray:
    """Relative joint angles of all arms from the directions of their links, (arms · 3,)."""
    found = []
    for index in range(len(lagrangian.scenario.arms)):
        angles = [np.arctan2(float(u[1]), float(u[0])) for u in lagrangian.links(pose, index)[1]]
        found += [angles[0], angles[1] - angles[0], angles[2] - angles[1]]
    return np.array(found)


@pytest.mark.parametrize("period", [1e-5, 0.0007095103730428927, 0.1])
def test_any_control_period_has_a_linear_model(period: float):
    """0.7095103730428927 ms was refused, as it has no step in common with a sample period that nobody had given."""
    scenario = still(**{"controller.control_period": period})
    model = flexlab.linearize(scenario, closed=True, outputs="joint_torque")
    np.testing.assert_allclose(np.abs(model.poles[:6]), np.abs(flexlab.linearize(scenario, closed=True).poles[:6]))
    assert model.dt == period


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_eigenvalues_are_those_of_an_independent_linearisation(gravity: float):
    """Each eigenvalue of the plant under the torques that hold it agrees to 1e-6 with that from energies of mass points."""
    scenario = still("gravity", **{"gravity": gravity, "payload.element_count": 3, "controller.kind": "pd"})
    model = flexlab.linearize(scenario, pose=(0.05, 0.7, 0.15))
    pose, torque = model.about.pose, model.about.torque.ravel()
    found = modes(scenario, (0.05, 0.7, 0.15)).linearization
    assert found is not None
    q = found.probe.beam.modes.V @ found.rest.motion.eta
    M, C, K, _ = open_loop_matrices(scenario, np.concatenate([pose, q]))
    lagrangian = Lagrangian(scenario, [0, 6])
    straight = np.zeros(len(M) - 3)
    start = joint_angles(lagrangian, np.concatenate([pose, straight]))

    def work(x: np.ndarray) -> float:
        turn = joint_angles(lagrangian, np.concatenate([x, straight])) - start
        return float(torque @ ((turn + np.pi) % (2 * np.pi) - np.pi))

    K[:3, :3] -= hessian(work, pose, NEAR)
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [np.linalg.solve(M, -K), np.linalg.solve(M, -C)]])
    expected, own = np.linalg.eigvals(A), np.linalg.eigvals(model.A)
    assert len(own) == len(expected)
    # Without weight, six eigenvalues are exactly 0 and defective: they are known only to the root of rounding.
    for value in own:
        assert np.abs(expected - value).min() < 1e-6 * abs(value) + (1e-3 if gravity == 0 and abs(value) < 0.01 else 0)
    assert (np.abs(own) > 0.01).sum() == len(own) - (6 if gravity == 0 else 0)


@pytest.mark.parametrize("law", ["adaptive-sliding-mode", "vibration-damping", "computed-torque", "pd"])
@pytest.mark.parametrize("sampling", [{}, HELD_TORQUES, SAMPLED], ids=["continuous", "held", "late"])
def test_the_model_answers_a_step_of_the_target_as_the_run_does(law: str, sampling: dict):
    """Model and simulation agree if the target jumps by 10 µm and 1e-5 rad: second-order terms are far smaller."""
    if law == "vibration-damping" and sampling == SAMPLED:
        sampling = {"controller.control_period": 5e-4, "controller.input_delay": 1}
    scenario = still(**{"controller.kind": law, **sampling})
    outputs = ("pose", "midspan_deflection", "joint_torque", "internal_force", "tracking_error", "arm_input")
    model = flexlab.linearize(scenario, inputs="desired_pose", outputs=outputs)
    assert model.about.closed
    step, period = np.array([1e-5, -1e-5, 1e-5]), sampling.get("controller.control_period", 1e-3)
    center = np.array(scenario.trajectory.center)
    begun = {"initial.pose": tuple(center), "trajectory.center": tuple(center + step)}
    run = simulate(scenario.replace(begun), 0.3, period)
    target = np.broadcast_to(step, (len(run), 3))
    if model.dt is None:
        shown = lsim(model, target, run.time)[1]
    else:
        shown = dlsim(model, target)[1]
    first = 0
    for name in outputs:
        signal = getattr(run, name).reshape(len(run), -1)
        own = shown[:, first : first + signal.shape[1]] + model.about.output_at_rest[first : first + signal.shape[1]]
        first += signal.shape[1]
        change = np.abs(signal - model.about.output_at_rest[first - signal.shape[1] : first]).max()
        # A symmetric step hardly changes the internal force: the change is itself of second order.
        assert np.abs(signal - own).max() < 1e-3 * max(change, 1e-3 if name == "internal_force" else 0.0), name


def test_the_sampled_plant_is_scipys_zero_order_hold():
    """With held torques it is `cont2discrete` of the continuous model; two periods of delay add a factor z⁻²."""
    plain, held = (flexlab.linearize(still(**more), outputs="pose") for more in ({}, HELD_TORQUES))
    expected = cont2discrete((plain.A, plain.B, plain.C, plain.D), 2e-3)
    np.testing.assert_allclose(held.A, expected[0], rtol=1e-9, atol=1e-9 * np.abs(expected[0]).max())
    np.testing.assert_allclose(held.B, expected[1], rtol=1e-6, atol=1e-9 * np.abs(expected[1]).max())
    late = flexlab.linearize(still(**SAMPLED), outputs="pose")
    assert late.state_names[-12:-6] == tuple(f"joint_torque_{s}_{j}_in_0" for s in ("left", "right") for j in (1, 2, 3))
    push = np.ones((9, 6))
    after, before = dlsim(late, push)[1], dlsim(held, push)[1]
    np.testing.assert_allclose(after[2:], before[:-2], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("sampling", [{}, SAMPLED])
def test_the_closed_models_eigenvalues_are_the_poles(sampling: dict):
    scenario = still("vibration-damping", **sampling)
    model, found = flexlab.linearize(scenario, closed=True), modes(scenario)
    own = model.poles  # Also for several outputs.
    np.testing.assert_array_equal(own, np.linalg.eigvals(model.A))
    if model.dt is not None:
        own = np.log(own[np.abs(own) > 1e-4].astype(complex)) / model.dt
    for pole in found.poles[np.abs(found.poles) < 3000]:
        assert np.abs(own - pole).min() < 1e-5 * abs(pole)
    assert model.disk_margin == found.disk_margin


def test_the_models_matrix_follows_from_its_mass_damping_and_stiffness():
    model = flexlab.linearize(load_preset("gravity"), (0.1, 0.7, 0.2))
    n = len(model.mass)
    np.testing.assert_allclose(model.mass, model.mass.T, atol=1e-12)
    np.testing.assert_allclose(model.stiffness, model.stiffness.T, atol=1e-6)
    np.testing.assert_allclose(model.mass @ model.A[n:, :n], -model.stiffness, rtol=1e-9, atol=1e-5)
    np.testing.assert_allclose(model.mass @ model.A[n:, n:], -model.damping, rtol=1e-9, atol=1e-9)
    frequency = np.sqrt(np.diag(model.stiffness)[3:]) / (2 * np.pi)
    np.testing.assert_allclose(frequency, modes(load_preset("gravity")).frequency, rtol=1e-9)


def test_joint_torques_act_as_the_task_inputs_that_they_make():
    torque, task = (
        flexlab.linearize(load_preset("paper"), inputs=i, outputs="arm_input") for i in ("joint_torque", "arm_input")
    )
    np.testing.assert_allclose(task.D, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(torque.B, task.B @ torque.D, atol=1e-9)
    assert task.input_units == ("N", "N", "N·m") * 2


def test_every_recorded_signal_can_be_an_output():
    names = [name for name in TABLE if name != "time"]
    model = flexlab.linearize(load_preset("single-arm"), inputs=("joint_torque", "desired_pose_rate"), outputs=names)
    assert len(model.output_names) == len(set(model.output_names)) == len(model.C)
    assert all(model.output_units)
    assert np.isfinite(model.C).all()
    assert np.isfinite(model.D).all()


def test_a_model_names_its_channels_and_their_units_and_prints_in_one_line():
    model = flexlab.linearize(load_preset("paper").replace(SAMPLED), inputs=("desired_pose", "joint_torque"))
    assert isinstance(model, StateSpace)
    assert isinstance(model, LinearModel)
    assert repr(model) == "LinearModel(closed loop, sampled at 2 ms, 26 states, 9 inputs, 3 outputs)"
    assert model.input_names[:4] == ("desired_pose_x", "desired_pose_y", "desired_pose_theta", "joint_torque_left_1")
    assert model.input_units[2:4] == ("rad", "N·m")
    assert dict(zip(model.state_names, model.state_units, strict=True))["mode_rate_1"] == "m·kg^½/s"
    assert "outputs: pose_x [m], pose_y [m], pose_theta [rad]" in str(model)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"inputs": "joint_torqe"}, "did you mean joint_torque"),
        ({"outputs": ("pose", "deflection")}, "'deflection' is not a signal"),
        ({"outputs": "pose_z"}, "'pose_z' is not a signal of a run: did you mean pose_y"),
        ({"inputs": "desired_pose_z"}, "did you mean desired_pose_y"),
        ({"outputs": ("pose", "pose_y")}, "pose_y is named twice"),
        ({"outputs": ()}, "outputs is empty"),
        ({"inputs": []}, "inputs is empty"),
        ({"pose": (9.0, 9.0, 0.0)}, "reach"),
        ({"inputs": "desired_pose", "closed": False}, "closed=False"),
    ],
)
def test_arguments_that_give_no_model_are_refused_in_a_sentence(arguments: dict, sentence: str):
    with pytest.raises(StudyError, match=sentence):
        flexlab.linearize(load_preset("paper"), **arguments)


@pytest.mark.parametrize(("kind", "part"), [("disturbance-observer", "_x"), ("super-twisting", "")])
def test_a_signal_of_the_law_alone_is_no_output(kind: str, part: str):
    """Its slopes would be zero: samples show it as the law last computed it."""
    name = {"disturbance-observer": "disturbance_estimate", "super-twisting": "twisting_force"}[kind]
    with pytest.raises(StudyError, match=f"{name} is a signal of the law {kind} alone"):
        flexlab.linearize(still(controller={"kind": kind}), outputs=("pose", name + part))


def test_a_loop_without_a_rest_point_has_no_linear_model():
    with pytest.raises(StudyError, match="no rest point"):
        flexlab.linearize(load_preset("gravity").replace({"controller.kind": "none"}))


@pytest.mark.parametrize("sampling", [{}, SAMPLED])
def test_python_control_accepts_the_model(sampling: dict):
    control = pytest.importorskip("control")
    model = flexlab.linearize(still(**sampling), inputs="desired_pose")
    other = model.to_control()
    assert isinstance(other, control.StateSpace)
    assert other.state_labels == list(model.state_names)
    assert other.dt == sampling.get("controller.control_period", 0)
    np.testing.assert_allclose(control.dcgain(other), np.eye(3), atol=1e-6)


def test_a_missing_python_control_is_asked_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(StudyError, match=r"flexlab\[control\]"):
        flexlab.linearize(load_preset("paper")).to_control()


NAMED = {"inputs": "desired_pose_y", "outputs": "vibration"}


@pytest.mark.parametrize("name", ["paper", "composite", "lqr", "single-arm"])
@pytest.mark.parametrize("channel", [NAMED, {"inputs": "joint_torque_left_2", "outputs": "pose_y", "closed": True}])
def test_scipys_frequency_response_of_a_channel_is_exact(name: str, channel: dict):
    """With scipy's polynomials, the response of a sampled loop with 39 states was off by its own size."""
    model = flexlab.linearize(name, **channel)
    assert (model.input_names, model.output_names) == ((channel["inputs"],), (channel["outputs"],))
    if model.dt is None:
        w, found = freqresp(model, np.logspace(-1, 4, 60))
        points = 1j * w
    else:
        w, found = dfreqresp(model, np.linspace(0.001, 3.1, 60))
        points = np.exp(1j * w)
    identity = np.eye(len(model.A))
    exact = np.array([(model.C @ np.linalg.solve(s * identity - model.A, model.B) + model.D)[0, 0] for s in points])
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())
    np.testing.assert_allclose(model.response(points)[:, 0, 0], exact, rtol=1e-6)
    magnitude = (bode if model.dt is None else dbode)(model, w)[1]
    np.testing.assert_allclose(magnitude, 20 * np.log10(np.abs(found)), atol=1e-9)


def test_a_transfer_function_is_exact_or_refused():
    paper = flexlab.linearize("paper", inputs="desired_pose_y", outputs="pose_y")
    function, s = paper.to_tf(), np.array([20j, 300j, 2000j])
    ratio = np.polyval(function.num, s) / np.polyval(function.den, s)
    np.testing.assert_allclose(ratio, paper.response(s)[:, 0, 0], rtol=1e-4)
    with pytest.raises(StudyError, match="Polynomials of 39 states lose the digits"):
        flexlab.linearize("lqr", inputs="desired_pose_y", outputs="pose_y").to_tf()
    np.testing.assert_array_equal(paper.response(20j), paper.response(s)[0])
    with pytest.raises(StudyError, match="points = '20' is not usable: give finite numbers s in 1/s"):
        paper.response("20")  # type: ignore[arg-type]  # A text is what is tried.
    with pytest.raises(StudyError, match=r"points = \[0, 2j\]: one is a pole, where the response is infinite"):
        flexlab.linearize("paper").response([0, 2j])
    nothing = flexlab.linearize("single-arm", inputs="desired_pose_y", outputs="internal_force_left_y")
    assert nothing.to_zpk().gain == 0
    assert not len(nothing.zeros)


@pytest.mark.parametrize("scenario", ["paper", "lqr"])
def test_a_transfer_function_can_be_had_for_one_of_several_inputs(scenario: str):
    several = flexlab.linearize(scenario, inputs="desired_pose", outputs="pose_y")
    one = flexlab.linearize(scenario, inputs="desired_pose_y", outputs="pose_y")
    found, wanted = several.to_zpk(input=1), one.to_zpk()
    assert found.gain == pytest.approx(wanted.gain, rel=1e-9)
    np.testing.assert_allclose(np.sort(np.abs(found.zeros)), np.sort(np.abs(wanted.zeros)), rtol=1e-6)
    if scenario == "paper":
        np.testing.assert_allclose(several.to_tf(input=1).num, one.to_tf().num, rtol=1e-6, atol=1e-6)
    for wrong in (3, -1, "x", True):
        with pytest.raises(StudyError, match=r"input = .* is not usable: give a whole number from 0 to 2"):
            several.to_tf(input=wrong)


@pytest.mark.parametrize("sampling", [{}, SAMPLED])
def test_methods_that_need_one_channel_say_so(sampling: dict):
    """scipy complained about arrays that could not be broadcast, and gave a transfer function of the first input only."""
    model: Any = flexlab.linearize(still(**sampling), inputs="desired_pose", outputs=("pose", "vibration"))
    needs_one = [
        model.to_zpk, model.to_tf, model.bode, model.freqresp, lambda: model.zeros,
        lambda: (dbode if sampling else bode)(model),
    ]  # fmt: skip
    for ask in needs_one:
        with pytest.raises(
            StudyError, match=r"one input and one output, and this model has 3 inputs and 4 outputs: name"
        ):
            ask()
    if not sampling:
        for ask in (model.step, model.impulse):
            with pytest.raises(StudyError, match=r"response needs one input, and this model has 3 inputs: name one"):
                ask()
        one = flexlab.linearize(still(), inputs="desired_pose_y", outputs=("pose", "vibration"))
        assert one.step(N=500)[1][-1, 1] == pytest.approx(1, abs=1e-3)
        held = one.to_discrete(1e-3)
        A, B, *_ = cont2discrete((one.A, one.B, one.C, one.D), 1e-3)
        np.testing.assert_array_equal(held.A, A)
        np.testing.assert_array_equal(held.B, B)


def test_a_model_of_some_channels_is_a_part_of_the_model_of_all():
    whole = flexlab.linearize("gravity", inputs=("joint_torque", "desired_pose_rate"), outputs=("pose", "joint_angle"))
    part = flexlab.linearize(
        "gravity", inputs=("desired_pose_rate_theta", "joint_torque_right_3"), outputs=("joint_angle_left_2", "pose_y")
    )
    columns = [whole.input_names.index(name) for name in part.input_names]
    rows = [whole.output_names.index(name) for name in part.output_names]
    np.testing.assert_array_equal(part.B, whole.B[:, columns])
    np.testing.assert_array_equal(part.C, whole.C[rows])
    np.testing.assert_array_equal(part.D, whole.D[np.ix_(rows, columns)])


def test_a_signal_computed_from_others_can_be_an_output():
    model = flexlab.linearize(
        "gravity", inputs="desired_pose_y", outputs=("vibration", "midspan_deflection", "quasi_static_deflection")
    )
    np.testing.assert_allclose(model.C[0], model.C[1] - model.C[2], atol=1e-12)
    assert model.output_units == ("m", "m", "m")
    assert "total_energy" in flexlab.linearize("gravity", outputs="total_energy").output_names
