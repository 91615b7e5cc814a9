"""The step of each tick: level k halves the longest step k times.

The level depends on the state at the tick alone, so that live, headless, continued and replayed runs take the same steps whatever
their block sizes. It follows the fastest rate of the controlled pose, which grows with the state of an adaptive controller, and
resolves how modes that are damped faster than the step answer a disturbance.
"""

import math
from copy import copy
from typing import NamedTuple

from flexlab.compiled import inlined
from flexlab.control.law_kernels import fastest_control_rate
from flexlab.physics.grips import whole_inertia
from flexlab.physics.joints import commanded_torques, has_motors, near_possible
from flexlab.physics.plant import ETA
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import law_places
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.integrators.etdrk4 import block_functions
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.step_size import CONTROLLED_STEP, SHORTEST_CHOSEN, build_scheme, control_limits

DISTURBED_LEVELS, DISTURBED_TICKS = 4, 6
"""If damping is notable, the first steps after a start, a tap or a change are finer by the first number of levels, and each of
these levels lasts for the second number of ticks."""
NOTABLE_DAMPING = 0.3
"""Step times D of the most damped mode from which on ticks after a disturbance get finer steps."""
LIMITED_STEP, NEAR_LIMIT = 1.5e-5, 0.6
"""Longest step, s, while a torque that a continuous law asks for is beyond this share of its limit: a step in which it reaches or
leaves the limit is of second order with every method."""
SLACK = 1.25
"""A step that is too long by less than this factor is kept: halving it would cost more than it gains."""


class StepWatch(NamedTuple):
    """What the kernel needs to choose a level."""

    step: float
    """Longest step, s: that of level 0."""
    most: int
    """Finest level; 0 if the step is given."""
    wished: float
    """Largest step times the fastest rate of the controlled pose for the accuracy, 1."""
    coarsest: float
    """Largest step times this rate for stability, 1."""
    disturbed: int
    """Number of levels by which the first steps after a disturbance are finer."""


@inlined
def near_limit(system, ws):
    """Whether a joint torque is at its limit or near it, after `find_state`."""
    plant, found = system.plant, False
    for i in range(len(plant.arms)):
        commanded_torques(plant.joints, plant.grips, plant.arms[i], i, ws, ws.tau)
        for joint in range(3):
            if abs(ws.tau[joint]) > NEAR_LIMIT * system.control.torque_limit[joint]:
                found = True
    return found or near_possible(plant.joints, plant.grips, ws, NEAR_LIMIT)


@inlined
def present_rate(grips, system, memory, ws):
    """Fastest rate of the controlled pose, as with rigid grips, 1/s, after `find_state`; memory (m,): the controller's state."""
    control, kappa = system.control, system.plant.kappa
    if grips is None:
        return fastest_control_rate(control, ws.truth[0], memory, ws.S, kappa)
    whole_inertia(system.plant.arms, ws)
    return fastest_control_rate(control, ws.measured[0], memory, ws.grips.inertia, kappa)


@inlined
def wanted_level(system, watch, y, ws):
    """The level of the step from state y, after `find_state`."""
    level = 0
    if watch.most > 0:
        # A sampled controller is only as fast as its control period.
        rate = 0.0
        start, end = law_places(system)
        if not system.control.sampled:
            rate = present_rate(system.plant.grips, system, y[start:end], ws)
        if rate > 0:
            longest = SLACK * min(watch.coarsest / rate, max(watch.wished / rate, CONTROLLED_STEP))
            step = watch.step
            while level < watch.most and step > longest:
                step, level = 0.5 * step, level + 1
        limited = system.control.limited or has_motors(system.plant.joints)
        if limited and not system.control.sampled and near_limit(system, ws):
            step = watch.step
            for _ in range(level):
                step *= 0.5
            while level < watch.most and step > LIMITED_STEP:
                step, level = 0.5 * step, level + 1
        if watch.disturbed > 0:
            since, finer = y[ETA + 2 * system.plant.modal.shape[1] + TICKS], watch.disturbed
            while since >= DISTURBED_TICKS and finer > 0:
                since, finer = since - DISTURBED_TICKS, finer - 1
            level = min(level + finer, watch.most)
    return level


class StepLevels:
    """The schemes of one beam and integrator for all levels, each made when it is first used."""

    def __init__(self, integrator: str, beam: Beam, step: float):
        """`step`: that of level 0, s."""
        self.integrator, self.step = integrator, step
        self._beam, modes = beam, beam.modes
        coupled = integrator == "etdrk4"
        self._functions = block_functions(modes.omega, modes.D, modes.block_start, step) if coupled else []
        """The beam's matrix functions for the first steps, block by block."""
        self._schemes: dict[int, Scheme] = {}
        self._halvings = 0
        """Place of level 0 among the schemes."""

    def scheme(self, level: int) -> Scheme:
        """The integrator's constants for a level."""
        place = level + self._halvings
        if place not in self._schemes:
            known = [block[place : place + 2] for block in self._functions]
            known = known if all(len(block) == 2 for block in known) else []
            self._schemes[place] = build_scheme(self.integrator, self._beam, self.step / 2**level, known)
        return self._schemes[place]

    def halved(self, times: int) -> "StepLevels":
        """The levels of a step that is halved so many times; schemes are shared."""
        finer = copy(self)
        finer.step, finer._halvings = self.step / 2**times, self._halvings + times
        return finer

    def watch(self, fixed: bool, accuracy: float) -> StepWatch:
        """What the kernel needs to choose a level; with `fixed`, a given step, it chooses none."""
        wished, coarsest = control_limits(self.integrator, accuracy)
        most = 0 if fixed else max(0, math.frexp(self.step / SHORTEST_CHOSEN)[1] - 1)
        damped = self.step * self._beam.modes.D.diagonal().max() > NOTABLE_DAMPING
        disturbed = DISTURBED_LEVELS if damped and self.integrator == "etdrk4" else 0
        return StepWatch(self.step, most, wished, coarsest, disturbed)
