"""Changes of the scenario in mid-run: the run goes on with other constants and no jump in state or torques, or begins anew."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexlab.control.law import Start, law_of
from flexlab.errors import ScenarioError
from flexlab.numerics.linear_algebra import product, solve
from flexlab.physics.beam import GAUSS_POINTS, gauss_rule
from flexlab.physics.dynamics import velocities_at
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA, noted_rates
from flexlab.physics.sensors import begin_reading
from flexlab.quantities import Part
from flexlab.scenario import Payload, Scenario
from flexlab.sim import accuracy, samples
from flexlab.sim.assembly import Assembly, with_transition_of
from flexlab.sim.build import payload_row
from flexlab.sim.closed_loop import System, new_workspace, own_parts, own_states_of, state_length
from flexlab.sim.commands import MESH_FIELDS, RESTART_FIELDS, ChangeScenario
from flexlab.sim.disturbance import set_pull_row, without_hand
from flexlab.sim.geometry import shape_functions
from flexlab.sim.motion import (
    Motion,
    act_at_start,
    begin_grip_states,
    begin_motion,
    controller_states,
    set_coordinates,
    start_controller,
    to_modes,
    until_next,
)
from flexlab.sim.signals import own_signals
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.stepping import observe
from flexlab.sim.target import change_path, equal_motions, go_on_from
from flexlab.sim.termination import check_trajectory, same_reach


def project_beam(old: Payload, new: Payload, M_q: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The new mesh's coordinates closest to the old shape in ∫ρ(w' - w)²ds, with the same mid-span value, (n_q',).

    M_q: mass matrix of the new mesh. A mesh of one pinned element meets that condition only
    if its mid-span can move at all.
    """
    cells = np.union1d(*(np.linspace(-p.length / 2, p.length / 2, p.element_count + 1) for p in (old, new)))
    points, weights = gauss_rule(GAUSS_POINTS)
    middles, halves = (cells[1:] + cells[:-1]) / 2, np.diff(cells) / 2
    s = (middles[:, None] + np.outer(halves, points)).ravel()
    w = product(shape_functions(old, s), q)
    load = product(new.linear_density * np.outer(halves, weights).ravel() * w, shape_functions(new, s))
    middle = payload_row(new, 0.0)
    projected, correction = solve(M_q, np.stack([load, middle], axis=1)).T
    give = product(middle, correction)
    if give > 0:
        projected += correction * (product(payload_row(old, 0.0), q) - product(middle, projected)) / give
    return projected


def change_in_motion(
    motion: Motion, command: ChangeScenario, known: Sequence[Assembly], at_once: bool
) -> tuple[Motion, bool]:
    """The motion after a change, and whether a new run begins.

    Raises `ScenarioError`, or `Unprepared` as `build_assembly` does. The given motion is not changed, except for its scratch.
    """
    scenario = change_path(motion.scenario, command.changes, motion.time)
    fault = None if same_reach(motion.scenario, scenario) else check_trajectory(scenario)
    if fault is not None:
        raise ScenarioError([("trajectory", fault.text)])
    known = [motion.assembly, *known]
    if not _goes_on(motion.scenario, scenario):
        anew = begin_motion(build_assembly(scenario.anew(), motion.tick_period, known, at_once))
        if anew.status.failed:
            raise ScenarioError([("initial", anew.status.text)])
        return anew, True
    reshaped = not (_same_mesh(motion.scenario, scenario) and own_signals(motion.scenario) == own_signals(scenario))
    assembly = build_assembly(scenario, motion.tick_period, known, at_once)
    if command.keeps_target:
        assembly = _go_on_from_target(motion, assembly)
    return _transferred(motion, assembly), reshaped


def _go_on_from_target(motion: Motion, assembly: Assembly) -> Assembly:
    """The assembly with a desired motion that goes on from where the old one is."""
    old = motion.assembly.system.trajectory
    if equal_motions(old, assembly.system.trajectory):
        return assembly
    scenario = go_on_from(motion.scenario, old, assembly.scenario, assembly.system.trajectory, motion.time)
    return with_transition_of(scenario, assembly)


def _transferred(motion: Motion, assembly: Assembly) -> Motion:
    """The motion with a new assembly: coordinates and velocities stay, momenta follow."""
    motion = replace(motion, y=motion.y.copy())
    before, old, scenario = motion.scenario, motion.assembly, assembly.scenario
    another_law, another_beam = not same_law(before, scenario), assembly.beam is not old.beam
    assembly = _with_hand(assembly, old)
    rate, eta, eta_dot = _coordinates_in(motion, assembly)
    starts_sampling = assembly.system.control.sampled and not old.system.control.sampled
    law_before = motion.law_start(False)
    parts, parts_before = (own_parts(system.plant) for system in (assembly.system, old.system))
    starts_lag = "torque" in parts and "torque" not in parts_before
    torques = _present_torques(motion) if starts_sampling or starts_lag else motion.assembly.system.held_torque
    _keep_torques(motion, assembly, torques if starts_sampling else None)
    motion.assembly, motion.level, motion.move = assembly, 0, None
    motion.estimate = accuracy.changed(motion.estimate, old, assembly, motion.tick)
    kept: tuple[str, ...] = ()
    if another_beam or another_law or parts != parts_before:
        y = np.zeros(state_length(assembly.system))
        y[:ETA] = motion.y[:ETA]
        states_before = own_states_of(old.system, motion.y)
        for name, states in own_states_of(assembly.system, y).items():
            states[:] = states_before.get(name, torques.ravel() if name == "torque" else 0.0)
        if "grips" not in parts_before:
            begin_grip_states(assembly, y, rate)
        kept = copy_states(before, old.system, motion.y, scenario, assembly.system, y)
        motion.y, motion.workspace = y, new_workspace(assembly.system)
    motion.workspace.desired_time[0] = np.nan
    set_coordinates(motion, motion.y[:3].copy(), rate, eta, eta_dot)
    law_now = motion.law_start(starts_sampling)
    if another_law:
        start_controller(scenario, assembly.system, law_now, motion.y, kept)
    else:
        adjust_states(scenario, assembly.system, law_before, law_now, motion.y)
    if starts_sampling:
        act_at_start(motion)
    if "reading" in parts and ("reading" not in parts_before or assembly.sampling.period != old.sampling.period):
        # The next reading may be less than a period away: the one before it is a period before that.
        period = assembly.sampling.period
        begin_reading(assembly.system.plant, period - until_next(period, motion.time), motion.y, motion.workspace)
    return motion


def _with_hand(assembly: Assembly, old: Assembly) -> Assembly:
    """The assembly with the hand of an old one, copied unless the two share it already: other assemblies may share the arrays."""
    pull = old.system.plant.pull
    if assembly.system.plant.pull is pull:
        return assembly
    plant = without_hand(assembly.system.plant)
    plant.pull[:] = pull
    set_pull_row(plant, assembly.scenario.payload, assembly.beam)
    return assembly._replace(system=assembly.system._replace(plant=plant))


def _coordinates_in(motion: Motion, assembly: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pose rate (3,), and modal coordinates and their rates in the beam of a new assembly."""
    old, plant = motion.assembly, motion.assembly.system.plant
    n = plant.modal.shape[1]
    find_mass_at(plant, motion.time, motion.workspace)
    velocities_at(plant, motion.y, motion.workspace)
    rate, eta_dot = motion.workspace.velocity.copy(), motion.workspace.eta_dot.copy()
    if old.levels.scheme(0).notes_rates and np.isfinite(noted_rates(motion.y, n)[-1]):
        eta_dot = noted_rates(motion.y, n).copy()  # the rates that the samples show
    q, q_dot = product(motion.y[ETA : ETA + n], plant.shapes), product(eta_dot, plant.shapes)
    if not _same_mesh(motion.scenario, assembly.scenario):
        meshes = motion.scenario.payload, assembly.scenario.payload, assembly.beam.matrices.M_q
        q, q_dot = project_beam(*meshes, q), project_beam(*meshes, q_dot)
    # The same arithmetic even where only a gain changed: the first recordings were made with it.
    return rate, to_modes(assembly.beam, q), to_modes(assembly.beam, q_dot)


def _present_torques(motion: Motion) -> np.ndarray:
    """Motor torques at the present instant, N·m, (arms, 3)."""
    row = np.zeros((1, motion.row_length))
    observe(motion, row[0])
    return samples.rows_to_samples(row, len(motion.scenario.arms), own_signals(motion.scenario)).joint_torque[0]


def _keep_torques(motion: Motion, assembly: Assembly, started: np.ndarray | None) -> None:
    """Let a sampled controller keep the torques that it holds and those under way; `started`: the first of one that begins."""
    held, old_line = motion.assembly.system.held_torque, motion.assembly.sampling.line
    assembly.system.held_torque[:] = assembly.sampling.line[:] = held if started is None else started
    if started is None:
        length = min(len(assembly.sampling.line), len(old_line))
        assembly.sampling.line[-length:] = old_line[-length:]


def same_motion(one: Scenario, other: Scenario) -> bool:
    """Whether a run can change from one scenario to the other as one motion, in which only a law's own signals may differ."""
    return _goes_on(one, other) and _same_mesh(one, other)


def _goes_on(one: Scenario, other: Scenario) -> bool:
    """Whether a run can go on when one scenario is changed to the other: with other arms or another start it begins anew."""
    return all(one.get(path) == other.get(path) for path in RESTART_FIELDS)


def _same_mesh(one: Scenario, other: Scenario) -> bool:
    """Whether beam coordinates mean the same in two scenarios."""
    return all(one.get(path) == other.get(path) for path in MESH_FIELDS)


def same_law(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios have the same law, whose memory and own signals mean the same in both."""
    if one.controller is other.controller and len(one.arms) == len(other.arms):
        return True
    laws = law_of(one.controller), law_of(other.controller)
    slices = [law.memory_slices(len(scenario.arms)) for law, scenario in zip(laws, (one, other), strict=True)]
    same = slices[0] == slices[1] and laws[0].signals == laws[1].signals
    return same and _kinds(one.controller) == _kinds(other.controller)


def _kinds(part: Part) -> list[str]:
    """The kinds of a controller and of its parts."""
    fields = vars(part)
    own = [fields["kind"]] if "kind" in fields else []
    return own + [kind for value in fields.values() if isinstance(value, Part) for kind in _kinds(value)]


def copy_states(
    old: Scenario, old_system: System, old_y: np.ndarray, new: Scenario, system: System, y: np.ndarray
) -> tuple[str, ...]:
    """Copy the parts of the controller's state that agree in name and length, and return their names; others stay zero."""
    before, kept = controller_states(old, old_system, old_y), []
    for name, part in controller_states(new, system, y).items():
        if name in before and len(before[name]) == len(part):
            part[:] = before[name]
            kept.append(name)
    return tuple(kept)


def adjust_states(scenario: Scenario, system: System, before: Start | None, begin: Start | None, y: np.ndarray) -> None:
    """Adjust the controller's state in y so that a change from `before` to `begin` does not make the law's answer jump."""
    law = law_of(scenario.controller)
    if law.bumpless_transfer is not None and before is not None and begin is not None:
        parts = controller_states(scenario, system, y)
        for name, values in law.bumpless_transfer(before, begin, parts).items():
            parts[name][:] = values
