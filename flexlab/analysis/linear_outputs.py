"""What the samples of a run show of small motions: the derivatives of any recorded signal at a rest point."""

import difflib
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexlab.analysis.differences import central, fourth_order
from flexlab.analysis.linearization import POSE_STEP, Linearization
from flexlab.analysis.loop_probe import aim
from flexlab.errors import StudyError
from flexlab.recording.table_columns import Column, table_columns
from flexlab.sim.world import World


class Outputs(NamedTuple):
    """Columns of signals, and their derivatives by (x, η, ẋ, η̇), memory, joint torques and (x_d, ẋ_d, ẍ_d)."""

    columns: tuple[Column, ...]
    at_rest: np.ndarray
    """(outputs,)."""
    by_motion: np.ndarray
    by_memory: np.ndarray
    by_torque: np.ndarray
    by_desired: np.ndarray


def choose_columns(linear: Linearization, signals: Sequence[str]) -> tuple[Column, ...]:
    """The columns of signals of a run, by name; raises `StudyError` for a name that no signal has."""
    every = table_columns(linear.probe.scenario)
    known = list(dict.fromkeys(column.signal for column in every))
    for name in signals:
        if name not in known:
            near = difflib.get_close_matches(str(name), known) or known
            raise StudyError(f"outputs: {name!r} is no signal of a run: did you mean {', '.join(near)}?")
    return tuple(column for name in signals for column in every if column.signal == name)


def linear_outputs(linear: Linearization, columns: tuple[Column, ...]) -> Outputs:
    """The derivatives of columns at the rest point, by differences of the samples that the engine writes."""
    probe, rest = linear.probe, linear.rest
    pose = tuple(rest.motion.x)
    bending = probe.scenario.trajectory.bending_feedforward
    path = {"trajectory": {"kind": "sine", "center": pose, "amplitude": 0.0, "bending_feedforward": bending}}
    begin = {"initial.pose": None, "initial.pose_rate": (0.0, 0.0, 0.0), "initial.beam_coordinates": None}
    world = World(probe.scenario.replace({**path, **begin}))
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

    directions, linear_part = np.eye(parts[-1] + 9), range(states, parts[-1])
    slopes = [
        central(sample, direction, 1.0) if k in linear_part else fourth_order(sample, direction, POSE_STEP)
        for k, direction in enumerate(directions)
    ]
    by = np.split(np.stack(slopes, axis=1), parts, axis=1)
    return Outputs(columns, sample(np.zeros(len(directions))), *by)
