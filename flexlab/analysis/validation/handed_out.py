"""What tables, files, plots and units of machine code hand out, with samples of which no number can stand for another.

And rows of the leaderboard that ships with flexlab, computed again here: the same bits on every machine.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from flexlab.analysis.comparison import Comparison
from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, verify
from flexlab.analysis.leaderboard.case import cases, chosen_cases
from flexlab.analysis.leaderboard.entry import entrants
from flexlab.analysis.leaderboard.report import overview
from flexlab.analysis.leaderboard.store import shipped_rows
from flexlab.analysis.metrics.run_metrics import run_metrics
from flexlab.analysis.validation.check import MOVING, PERIOD, Check, Runs, alike, below, subject, true
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.fmi.description import desired_motion, inputs, law_signals, sample_variables, sensors, torques
from flexlab.fmi.parts import GIVEN, before_acting, given_motion, law_sensors
from flexlab.presets import load_preset
from flexlab.quantities import base_exponents
from flexlab.recording.codec import decode_block, encode_block
from flexlab.recording.export import FORMATS
from flexlab.recording.table_columns import from_columns, table_columns, to_columns
from flexlab.scenario import Scenario
from flexlab.sim.motion import begin_motion
from flexlab.sim.sampled_control import answer_sensors
from flexlab.sim.samples import Samples, row_length, rows_to_samples
from flexlab.sim.signals import own_signals
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.stepping import fill
from flexlab.text import typed_number
from flexlab.views import ELASTIC, own_views, views

FIRST = 3
"""Number of the law of the first published row that is computed again.
With it the grips that give way are held by a law whose run takes few steps."""
INSTANTS = 700
"""Number of samples, more than are packed at once."""
EVERYTHING = {
    "controller.kind": "super-twisting",
    "joints.friction.viscous": (1.0, 1.0, 1.0),
    "joints.motor.time_constant": 0.01,
    "payload.mass_change.factor": 2.0,
    "grips.model": "compliant",
}
"""A scenario whose law, joints, payload and grips have signals of their own."""
UNITS: dict[str, tuple[int, int, int]] = {
    "N": (1, 1, -2),
    "N·m": (1, 2, -2),
    "J": (1, 2, -2),
    "m/s²": (0, 1, -2),
    "N/m": (1, 0, -2),
    "N·s²/m²": (1, -1, 0),
    "kg·m²/s": (1, 2, -1),
    "1": (0, 0, 0),
}
"""Unit → its exponents of kg, m and s."""
SCALES = {"mm": 1e3, "µm": 1e6, "mrad": 1e3, "mJ": 1e3, "%": 100.0, "N/min": 60.0}
"""Unit of a table → its number per SI unit; 1 for any other."""


class _MadeUp(NamedTuple):
    scenario: Scenario
    rows: np.ndarray
    samples: Samples


def _made_up() -> _MadeUp:
    """Rows of random numbers, and what they say."""
    scenario = load_preset("paper").replace(EVERYTHING)
    own = own_signals(scenario)
    rows = np.random.default_rng(7).normal(size=(INSTANTS, row_length(2, scenario.payload.coordinate_count, own)))
    samples = rows_to_samples(rows, 2, own)
    rows[:, 0] = np.arange(INSTANTS) * PERIOD
    return _MadeUp(scenario, rows, samples)


@subject("Tables, files and plots", 23)
def handed_out(runs: Runs) -> Iterator[Check]:
    """Columns of tables, files that are read again, curves of plots, variables of units, metrics of several runs."""
    made = _made_up()
    told, seen = to_columns(made.samples, table_columns(made.scenario)), made.samples
    wanted = {
        "time [s]": seen.time,
        "pose_theta [rad]": seen.pose[:, 2],
        "pose_rate_y [m/s]": seen.pose_rate[:, 1],
        "pose_acceleration_theta [rad/s²]": seen.pose_acceleration[:, 2],
        "bound_estimates_2 [N·s²/m²]": seen.bound_estimates[:, 2],
        "beam_coordinates_node1_deflection [m]": seen.beam_coordinates[:, 1],
        "beam_rates_node2_slope [rad/s]": seen.beam_rates[:, 3],
        "joint_torque_right_2 [N·m]": seen.joint_torque[:, 1, 1],
        "internal_force_left_x [N]": seen.internal_force[:, 0, 0],
        "internal_force_right_theta [N·m]": seen.internal_force[:, 1, 2],
        "kinetic_energy [J]": seen.kinetic_energy,
        "twisting_force_theta [N·m]": seen["twisting_force"][:, 2],
        "right_grip_displacement_turn [rad]": seen["right_grip_displacement"][:, 2],
        "payload_mass [kg]": seen["payload_mass"],
    }
    wrong = [name for name, values in wanted.items() if not np.array_equal(told.get(name, np.empty(0)), values)]
    yield true("columns of a table are the signals, in the units of their names", not wrong, ", ".join(wrong))
    yield from _files(made)
    yield from _plots(made)
    yield from _units(made, told)
    yield from _metrics(runs)
    yield from _leaderboard()


def _files(made: _MadeUp) -> Iterator[Check]:
    """Samples that are written in two pieces, and read again."""
    columns, middle = table_columns(made.scenario), INSTANTS // 3
    again = {"blocks of a recording": decode_block(encode_block(made.samples))[0]}
    pieces = [to_columns(made.samples.slice(*ends), columns) for ends in ((0, middle), (middle, INSTANTS))]
    with TemporaryDirectory(prefix="flexlab-") as folder:
        for suffix, (write, read) in FORMATS.items():
            file = Path(folder) / f"run{suffix}"
            write(file, pieces, "{}")
            again[suffix] = from_columns(read(file)[0], made.scenario)[0]
    exact = made.samples.signals()
    for words, samples in again.items():
        found = samples.signals()
        wrong = [name for name, values in exact.items() if not np.array_equal(found.get(name, np.empty(0)), values)]
        yield true(f"{words}: every signal is read as it was written, bit for bit", not wrong, ", ".join(wrong))


def _plots(made: _MadeUp) -> Iterator[Check]:
    """Curves of all plots, in their order."""
    s = made.samples
    ringing = s.midspan_deflection - s.quasi_static_deflection
    total = s.kinetic_energy + s.elastic_energy + s.gravity_energy
    wanted = [
        *s.tracking_error.T, ringing, s.midspan_deflection, s.quasi_static_deflection, *s.internal_force[:, 0].T,
        *s.joint_torque[:, 0].T, *s.joint_torque[:, 1].T, *s.sliding_variable.T, *s.bound_estimates.T,
        s.kinetic_energy, s.elastic_energy, s.gravity_energy, total, s.input_work, s.axial_work, s.dissipated_energy,
        *s.axial_load.T, s.axial_load_share, s.spin_share, s.elastic_energy,
    ]  # fmt: skip
    drawn = [view for view in (*views(made.scenario), ELASTIC) if view not in own_views(made.scenario)]
    told = {
        f"{view.title}: {curve}": values / SCALES.get(unit, 1.0)
        for view in drawn
        for curve, unit, values in zip(view.curves, view.units, view.values(s).T, strict=True)
    }
    wrong = [name for (name, values), exact in zip(told.items(), wanted, strict=True) if not np.allclose(values, exact)]
    yield true("curves of plots are the signals of their names, in their units", not wrong, ", ".join(wrong))


def _units(made: _MadeUp, told: dict[str, np.ndarray]) -> Iterator[Check]:
    """Variables of units (FMI): where they stand in memory, here one number after another, and their units."""
    outputs = sample_variables(made.scenario, made.rows[0], 0, True)
    wrong = [each.name for each in outputs if made.rows[0, each.place // 8] != told[f"{each.name} [{each.unit}]"][0]]
    yield true("units: outputs stand where the sample has them, in its units", not wrong, ", ".join(wrong))
    law, start = made.scenario, np.arange(12.0)
    known = [
        *torques(law, start[:6], 0, "input"), *inputs(law, 0), *law_signals(law, 0), *sensors(law, start, 0, "input"),
        *desired_motion(start[:9], 0),
    ]  # fmt: skip
    found = {each.name: (each.unit, each.place // 8) for each in known}
    wanted = {
        "motor_torque_left_3": ("N·m", 2), "motor_torque_right_1": ("N·m", 3), "input_left_y": ("N", 1),
        "input_right_theta": ("N·m", 5), "twisting_force_x": ("N", 0), "twisting_force_theta": ("N·m", 2),
        "pose_theta": ("rad", 2), "pose_rate_x": ("m/s", 3), "pose_rate_theta": ("rad/s", 5),
        "beam_moment_rate_h": ("kg·m/s", 6), "beam_moment_rate_g": ("kg·m²/s", 7), "strain_0": ("1", 8),
        "desired_pose_y": ("m", 1), "desired_rate_theta": ("rad/s", 5), "desired_acceleration_x": ("m/s²", 6),
    }  # fmt: skip
    wrong = [name for name, about in wanted.items() if found.get(name) != about]
    wrong += [each.name for each in known if each.start not in (None, each.place / 8)]
    yield true("and inputs, measurements and signals of laws in their order", not wrong, ", ".join(wrong))
    wrong = [
        unit
        for unit, powers in UNITS.items()
        if base_exponents(unit) != {name: power for name, power in zip(("kg", "m", "s"), powers, strict=True) if power}
    ]
    yield true("units in base units: exponents of kg, m and s", not wrong, ", ".join(wrong))
    yield from _parts_of_units()


def _parts_of_units() -> Iterator[Check]:
    """A law that is told what sensors read, and a target that goes on from what is given."""
    law = {"kind": "lqr", "control_period": PERIOD}
    scenario = load_preset("paper").replace({**MOVING, "controller": law})
    motion = begin_motion(build_assembly(scenario, PERIOD))
    system, sampling = motion.assembly.system, motion.assembly.sampling
    held, told, rows = system.held_torque.copy(), law_sensors(motion), np.zeros((5, motion.row_length))
    before_acting(motion)
    answer_sensors(system, sampling._replace(kernel=0), 0, 0.0, told, motion.y, motion.workspace)
    same = np.array_equal(system.held_torque, held) and bool(held.any())
    yield true("units: a law that is told what sensors read asks for the torques of the loop, bit for bit", same)
    fill(motion, rows)
    told, seen, points = law_sensors(motion), rows_to_samples(rows[-1:], 2), MassPoints(scenario)
    moments = points.payload_inertia(np.zeros(3 + seen.beam_rates.shape[1]))[1:3, 3:] @ seen.beam_rates[0]
    places = scenario.payload.length * np.array(scenario.controller.observer.gauges)
    strain = -scenario.payload.thickness / 2 * points.shapes(places, 2) @ seen.beam_coordinates[0]
    part = told / np.concatenate([seen.pose[0], seen.pose_rate[0], moments, strain]) - 1
    yield below("and a plant tells pose, rate, hᵀq̇, gᵀq̇ and strains: relative error", 1e-7, part)
    given, found = np.zeros(1, GIVEN).view(np.recarray), np.zeros((3, 3))
    given.time, given.pose, given.rate, given.acceleration = 0.5, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)
    given_motion.py_func(given[0], None, 0.7, found)
    jets = np.arange(1.0, 10.0).reshape(3, 3)
    exact = [jets[0] + 0.2 * jets[1] + 0.02 * jets[2], jets[1] + 0.2 * jets[2], jets[2]]
    yield alike("a follower's target goes on with its rate and acceleration: relative error", 1e-12, found, exact)


def _metrics(runs: Runs) -> Iterator[Check]:
    """Metrics in tables and by their earlier names, and a comparison of two runs."""
    one, other = (run_metrics(runs.paper, window, own=False) for window in ((0.0, 3.0), (2.0, 6.0)))
    exact, scale = np.array([one.numbers, other.numbers]), np.array([SCALES.get(row.unit, 1.0) for row in one.rows])
    told = [[[row.value, each[row.column.field]] for row in each.rows] for each in (one, other)]
    statement = "metrics of tables, also by their earlier names, are those in SI units times the unit's scale"
    yield true(statement, np.allclose(told, (scale * exact)[:, :, None], rtol=1e-12, atol=0, equal_nan=True))
    recordings = [SimpleNamespace(path=Path(name), scenario=runs.paper.scenario, status="finished") for name in "AB"]
    compared: Any = Comparison(tuple(recordings), (3.0, 4.0), 3.0, tuple(zip(one.rows, other.rows, strict=True)), ())
    told = np.array([compared.table[name].to_numpy(zero_copy_only=False) for name in one.by_name()], float)
    yield true("a comparison has those in SI units", np.allclose(told.T, exact, rtol=1e-12, atol=0, equal_nan=True))
    less = [typed_number(line[-1].replace("−", "-")) for line in compared.metric_table()[1:]]
    wanted = (scale * np.diff(exact, axis=0)[0])[[row.applies for row in one.rows]]
    yield true("and tells B - A, with three digits", np.allclose(less, wanted, rtol=5e-3, atol=0, equal_nan=True))


def _leaderboard() -> Iterator[Check]:
    """Scores in the units of its table, and the overview.

    That is the geometric mean over a case's variants, of the main score over the best law's, over the best such mean.
    """
    board = Leaderboard(chosen_cases(None, long=True), shipped_rows())
    columns = [score.column for case in board.cases for score in case.scores]
    wrong = [column.title for column in columns if column.scale != SCALES.get(column.unit, 1.0)]
    numbers = board.table.select(["value", "shown", "unit"]).to_pylist()
    wrong += [
        str(row) for row in numbers if row["value"] and row["shown"] != row["value"] * SCALES.get(row["unit"], 1.0)
    ]
    yield true("leaderboard: scores are in the units that stand beside them", not wrong, ", ".join(wrong))
    grid, off = dict(overview(board).lines), []
    for place, (name, main) in enumerate((case.name, case.main) for case in board.cases):
        told = {law: typed_number(cells[place].text.replace("\u202f", "")) for law, cells in grid.items()}
        rows = [row for row in board.rows if row.case == name and row.scores.get(main.name) is not None]
        score = {(row.variant, row.law): max(row.scores[main.name], main.floor) for row in rows}
        best = {variant: min(value for (where, _), value in score.items() if where == variant) for variant, _ in score}
        mean = {
            law: np.exp(np.mean([np.log(value / best[where]) for (where, who), value in score.items() if who == law]))
            for law in told
            if np.isfinite(told[law])
        }
        off += [told[law] / (value / min(mean.values())) - 1 for law, value in mean.items()]
    yield below("leaderboard: geometric means of scores over the best law's, with three digits: error", 6e-3, off)


@subject("The published leaderboard", 25)
def published(_: Runs) -> Iterator[Check]:
    """A row of every variant of every case, with the laws in turn: status, sentence, scores and all samples."""
    rows = shipped_rows()
    laws = list(dict.fromkeys(row.law for row in rows))
    variants = dict.fromkeys((row.case, row.variant) for row in rows)
    chosen = {(*variant, laws[(FIRST + number) % len(laws)]) for number, variant in enumerate(variants)}
    kept = [row for row in rows if row.place in chosen]
    tasks = make_tasks(cases().values(), tuple(entrants().values()), seed=kept[0].seed)
    for row, difference in sorted(verify(kept, tasks), key=lambda found: found[0].place):
        yield true(f"{row.law} in {row.case} {row.variant}".rstrip() + ": every bit", not difference, difference)
