"""`flexlab.linearize`: a linear model of plant, or plant and law, about a rest point, from named inputs to named outputs.

Any recorded signal but a law's own can be an output: its derivatives at the rest point are differences of the engine's samples.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexlab.analysis.linear_model import About, LinearModel, Named, make_model
from flexlab.analysis.linearization import POSE_STEP, Linearization, central, first_order, fourth_order
from flexlab.analysis.modes import check_pose, linearize_at, loop_note
from flexlab.analysis.rest_point import aim
from flexlab.analysis.stability import beam_scale, close_loop, find_disk_margin, find_poles, kept_memory, with_lag
from flexlab.arguments import flag
from flexlab.control.law import law_of
from flexlab.control.observers.believed_plant import hold
from flexlab.errors import StudyError
from flexlab.lapack import one_blas_thread
from flexlab.presets import AnyScenario, any_scenario
from flexlab.recording.table_columns import Column, table_columns
from flexlab.signal import ARM, AXIS
from flexlab.sim.signals import POSE_UNITS
from flexlab.sim.world import World

TORQUE, TASK = "joint_torque", "arm_input"
DESIRED = ("desired_pose", "desired_pose_rate", "desired_pose_acceleration")
INPUTS = (TORQUE, TASK, *DESIRED)
FORCE_UNITS = ("N", "N", "N·m")


def linearize(
    scenario: AnyScenario,
    pose: tuple[float, float, float] | None = None,
    inputs: str | Sequence[str] = TORQUE,
    outputs: str | Sequence[str] = "pose",
    closed: bool | None = None,
) -> LinearModel:
    """The linear model about the loop's rest point while `pose` (None: the trajectory's centre) is held.

    `inputs`: "joint_torque" (N·m, of each joint), "arm_input" (u_i = 𝒥ᵀτ, N, N, N·m), "desired_pose", "desired_pose_rate",
    "desired_pose_acceleration". The last three are independent inputs here: a step in "desired_pose" alone is a target that
    jumps and then stands. `outputs`: names of a run's signals, but not of a law's own. One part of either may be named, such as
    "desired_pose_y" or "pose_y".
    `closed`: whether the control law acts, with the inputs added to its torques; None: if a desired pose is an input.

    With a control period the model describes control instants: torques are held and delayed by the input delay, and outputs
    are those just after the law has acted. A law that looks ahead on the path, as `lqr` does by its delay, sees it go on with
    the desired acceleration. States: pose, modal coordinates (in ascending frequency), their rates, the part of the law's
    memory that changes to first order, torques on their way. Raises `ScenarioError` for an invalid scenario, and `StudyError`
    for unknown names, a pose that an arm cannot take, or a loop without a rest point.
    """
    known = any_scenario(scenario).replace({})
    driven = _driven(inputs, len(known.arms))
    shown = _listed("outputs", outputs)
    acts = [part.name for signal, _, part in driven if signal in DESIRED]
    acting = bool(acts) if closed is None else flag("closed", closed)
    if acts and not acting:
        raise StudyError(f"{acts[0]} drives the control law: with closed=False choose {TORQUE} or {TASK} as inputs.")
    if not shown:
        raise StudyError("outputs is empty: name one or more signals of a run, such as 'pose'.")
    with one_blas_thread():
        linear = linearize_at(known, check_pose(known, pose))
        answers = linear_outputs(linear, choose_columns(linear, shown))
        return _assemble(linear, answers, driven, acting)


Part = tuple[str, int, Named]
"""A part of an input: the input's name, the part's place in it, and its own name and unit."""


def _driven(inputs: str | Sequence[str], arms: int) -> list[Part]:
    """The parts of the named inputs, in their order."""
    names = _listed("inputs", inputs)
    parts = [(signal, place, part) for signal in INPUTS for place, part in enumerate(_parts(signal, arms))]
    known = {signal: [part.name for name, _, part in parts if name == signal] for signal in INPUTS}
    _check_known("inputs", names, known, "an input of a linear model")
    if not names:
        raise StudyError(f"inputs is empty: name one or more of {', '.join(INPUTS)}.")
    return [each for name in names for each in parts if name in (each[0], each[2].name)]


def _check_known(what: str, names: Sequence[str], known: Mapping[str, Sequence[str]], kind: str) -> None:
    """Refuse unknown and repeated names; `known`: name → names of its parts."""
    named: list[str] = []
    for name in names:
        parts = known.get(name) or [part for parts in known.values() for part in parts if part == name]
        if not parts:
            near = difflib.get_close_matches(str(name), [*known, *(part for parts in known.values() for part in parts)])
            raise StudyError(f"{what}: {name!r:.60} is not {kind}: did you mean {', '.join(near or known)}?")
        named += parts
    if twice := [part for part in named if named.count(part) > 1]:
        raise StudyError(f"{what}: {twice[0]} is named twice.")


def _listed(what: str, names: str | Sequence[str]) -> tuple[str, ...]:
    if isinstance(names, str):
        return (names,)
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise StudyError(f"{what} = {names!r:.60} is not usable: give a name, or a list of names.")
    return tuple(names)


def _drive(linear: Linearization, driven: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Effect of the inputs on the joint torques, (arms · 3, inputs), and on (x_d, ẋ_d, ẍ_d), (9, inputs)."""
    torques = linear.torque_count
    effect = {TORQUE: np.eye(torques), TASK: np.linalg.inv(linear.probe.task_inputs(linear.rest.motion))}
    torque, desired = np.zeros((torques, len(driven))), np.zeros((9, len(driven)))
    for column, (signal, place, _) in enumerate(driven):
        if signal in effect:
            torque[:, column] = effect[signal][:, place]
        else:
            desired[3 * DESIRED.index(signal) + place, column] = 1.0
    return torque, desired


def _parts(signal: str, arms: int) -> list[Named]:
    if signal == TORQUE:
        return _of_joints(signal, 3 * arms)
    if signal == TASK:
        return [each for side in ARM.labels[:arms] for each in _of_axes(f"{signal}_{side}", FORCE_UNITS)]
    return _of_axes(signal, POSE_UNITS, ("", "/s", "/s²")[DESIRED.index(signal)])


def _of_axes(name: str, units: Sequence[str], per: str = "") -> list[Named]:
    return [Named(f"{name}_{axis}", unit + per) for axis, unit in zip(AXIS.labels, units, strict=True)]


def _of_joints(name: str, count: int, place: str = "") -> list[Named]:
    return [Named(f"{name}_{ARM.labels[k // 3]}_{k % 3 + 1}{place}", "N·m") for k in range(count)]


def _assemble(linear: Linearization, answers: "Outputs", driven: Sequence[Part], closed: bool) -> LinearModel:
    """A, B, C, D for the states (x, η, ẋ, η̇, lagging motors' torques, memory, torques on their way)."""
    controller, law, torques = linear.probe.original.controller, linear.law, linear.torque_count
    period, late = controller.control_period, torques * controller.input_delay
    kept = kept_memory(linear) if closed else np.zeros(0, dtype=int)
    A, B = first_order(linear.plant)
    m = len(A)
    A, B = with_lag(A, B, linear.probe.original.joints.motor.time_constant)
    n, own, line = len(A), len(A) + len(kept), max(late, law.line.shape[1] * closed)
    if period is not None:
        scale = np.concatenate([beam_scale(linear), np.ones(n - m)])
        A, B = hold(A * scale[:, None] / scale, B * scale[:, None], period)
        A, B = A / scale[:, None] * scale, B / scale[:, None]
    # The torques that are asked for and the memory's change, by states and then by inputs.
    size, (torque, desired) = own + line, _drive(linear, driven)
    answer = np.zeros((torques + len(kept), size + len(driven)))
    answer[:torques, size:] = torque
    if closed:
        rows = np.concatenate([np.arange(torques), torques + kept])
        answer[:, :m], answer[:, n:own] = law.motion[rows], law.memory[np.ix_(rows, kept)]
        answer[:, own : own + law.line.shape[1]] = law.line[rows]
        answer[:, size:] += law.desired[rows] @ desired
    asked, memory = np.split(answer, [torques])
    if period is not None:
        memory[:, n:own] += np.eye(len(kept))
    whole, held = close_loop(A, B, asked, memory, line, late)
    # The sample of a control instant shows the memory after that instant.
    remembered = np.eye(len(kept), size + len(driven), n) if period is None else memory
    given = held if n == m else np.eye(torques, size + len(driven), m)
    shown = answers.by_memory[:, kept] @ remembered + answers.by_torque @ given
    shown[:, :m] += answers.by_motion
    shown[:, size:] += answers.by_desired @ desired
    order = _state_order(linear, own - m, line)
    matrices = (whole[np.ix_(order, order)], whole[order, size:], shown[:, order], shown[:, size:])
    return make_model(matrices, period, _about(linear, answers, driven, closed, len(kept), line))


def _state_order(linear: Linearization, memory: int, line: int) -> np.ndarray:
    """Indices of the states in the model's order: modes ascend in frequency, while the engine groups them by damping."""
    count = linear.probe.mode_count
    ranked, start = np.argsort(linear.omega, kind="stable"), 6 + 2 * count
    return np.concatenate(
        [range(3), 3 + ranked, range(3 + count, 6 + count), 6 + count + ranked, range(start, start + memory + line)]
    ).astype(int)


def _about(
    linear: Linearization, answers: "Outputs", driven: Sequence[Part], closed: bool, memory: int, line: int
) -> About:
    count, torques = linear.probe.mode_count, linear.torque_count
    late = linear.probe.original.controller.input_delay
    # For a law that uses torques, those held until now are states.
    places = ["held"] * (line // torques - late) + [f"in_{step}" for step in range(late)]
    states = _of_axes("pose", POSE_UNITS) + [Named(f"mode_{k + 1}", "m·kg^½") for k in range(count)]
    states += _of_axes("pose_rate", POSE_UNITS, "/s") + [Named(f"mode_rate_{k + 1}", "m·kg^½/s") for k in range(count)]
    if linear.probe.original.joints.motor.time_constant > 0:
        states += _of_joints("motor_torque", torques)
    states += [Named(f"memory_{k + 1}", "1") for k in range(memory)]
    states += [each for place in places for each in _of_joints(TORQUE, torques, f"_{place}")]
    outputs = tuple(Named(column.part, column.unit) for column in answers.columns)
    order = _state_order(linear, 0, 0)[: 3 + count]
    mass, damping, stiffness = (
        part[np.ix_(order, order)] for part in (linear.plant.mass, linear.plant.damping, linear.plant.stiffness)
    )
    return About(
        states=tuple(states), inputs=tuple(part for _, _, part in driven), outputs=outputs,
        mass=mass, damping=damping, stiffness=stiffness, pose=linear.rest.motion.x.copy(),
        torque=linear.rest.torque.reshape(-1, 3).copy(), output_at_rest=answers.at_rest, closed=closed, input_delay=late,
        note=loop_note(linear), disk_margin=find_disk_margin(linear, find_poles(linear).value),
    )  # fmt: skip


class Outputs(NamedTuple):
    """Output columns, and their derivatives with respect to (x, η, ẋ, η̇), memory, joint torques and (x_d, ẋ_d, ẍ_d)."""

    columns: tuple[Column, ...]
    at_rest: np.ndarray
    """(outputs,)."""
    by_motion: np.ndarray
    by_memory: np.ndarray
    by_torque: np.ndarray
    by_desired: np.ndarray


def choose_columns(linear: Linearization, signals: Sequence[str]) -> tuple[Column, ...]:
    """The columns of the named signals, or parts of signals. Raises `StudyError` for an unknown name, and a law's own signal."""
    every = table_columns(linear.probe.scenario, derived=True)
    known: dict[str, list[str]] = {}
    for column in every:
        known.setdefault(column.signal, []).append(column.part)
    _check_known("outputs", signals, known, "a signal of a run")
    columns = tuple(column for name in signals for column in every if name in (column.signal, column.part))
    law = law_of(linear.probe.scenario.controller)
    if lost := {signal.name for signal in law.signals} & {column.signal for column in columns}:
        raise StudyError(
            f"outputs: {min(lost)} is a signal of the law {law.kind} alone, which a linear model does not give: choose "
            "signals of arms and payload, such as pose, or look for the law's memory among the states."
        )
    return columns


def linear_outputs(linear: Linearization, columns: tuple[Column, ...]) -> Outputs:
    """The derivatives of columns at the rest point, by differences of the engine's samples."""
    probe, rest = linear.probe, linear.rest
    pose = tuple(rest.motion.x)
    bending = probe.scenario.trajectory.bending_feedforward
    path = {"trajectory": {"kind": "sine", "center": pose, "amplitude": 0.0, "bending_feedforward": bending}}
    begin = {"initial.pose": None, "initial.pose_rate": (0.0, 0.0, 0.0), "initial.beam_coordinates": None}
    world = World(probe.scenario.replace({**path, **begin}), probe.scenario.controller.control_period)
    state = world.state()
    states, memory, torques = probe.size, len(rest.memory), linear.torque_count
    parts = np.cumsum([states, memory, torques])

    def sample(step: np.ndarray) -> np.ndarray:
        motion, own, torque, desired = np.split(step, parts)
        aim(world.system, rest.desired + desired.reshape(3, 3))
        held = (rest.torque + torque).reshape(-1, 3)
        y = probe.state(rest.motion.moved(motion), rest.memory + own)
        world.restore(replace(state, y=y, held_torque=held, torque_line=held[None].copy()))
        samples = world.observe()
        return np.array([getattr(samples, column.signal)[(0, *column.index)] for column in columns])

    step = min(POSE_STEP, probe.rate_step)
    directions, linear_part = np.eye(parts[-1] + 9), range(states, parts[-1])
    slopes = [
        central(sample, direction, 1.0) if k in linear_part else fourth_order(sample, direction, step)
        for k, direction in enumerate(directions)
    ]
    by = np.split(np.stack(slopes, axis=1), parts, axis=1)
    return Outputs(columns, sample(np.zeros(len(directions))), *by)
