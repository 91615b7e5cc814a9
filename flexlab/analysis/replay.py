"""Replay: a second simulation of a recorded run from its start and its commands, and the comparison of the two.

Every bit has to be the same. A tolerance applies only where rounding may differ: for recordings made with an earlier arithmetic,
and for control laws in Python, whose rounding depends on the machine.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from flexlab.analysis.result import Result, provenance
from flexlab.analysis.resume import Repetition
from flexlab.control.law import laws
from flexlab.errors import StudyError
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES
from flexlab.own.law import OwnController
from flexlab.own.link import address_in
from flexlab.own.modules import packages_of
from flexlab.own.path import OwnTrajectory
from flexlab.own.reading import without_data
from flexlab.own.unit import unit_in
from flexlab.recording.reader import Recording
from flexlab.recording.run_info import PACKAGES, these_versions
from flexlab.recording.store.formats import ARITHMETIC, FORMAT
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples
from flexlab.sim.signals import TABLE, known_signals
from flexlab.sim.world import World
from flexlab.text import number_text, visible

TOLERANCE = 3e-7
"""Largest difference attributed to rounding, relative to the signal's largest value in the run. Other BLAS kernels and C
libraries cause 1e-11 within a second under most laws, and 2e-7 under those that solve a Riccati equation; a relative change of a
gain by 1e-6 causes 4e-7 or more in at least one signal."""
LONGEST, MOST = 40, 8
"""Characters of a package's name or version, and number of packages, in a sentence."""
AT_REST = 1e-6
"""Lower bound of a signal's largest value, in SI units and relative to the largest value of all signals with the same units: a
difference of two numbers has their rounding errors."""


@dataclass(frozen=True)
class Difference:
    """The first difference between a replay and its recording."""

    time: float
    """Simulation time, s."""
    signal: str
    """Name of the field of `Samples`."""
    recorded: float
    replayed: float


@dataclass(frozen=True)
class Replay(Result):
    """The result of a replay."""

    compared: int
    """Number of compared samples."""
    difference: Difference | None
    """The first difference; None if the two agree, bit for bit or within `TOLERANCE`."""
    text: str
    """The result in a sentence or two."""
    deviation: float | None = None
    """Largest rounding difference, relative to the signal's largest value; None if all bits are the same."""
    scenario: Scenario | None = None
    """The scenario at the start of the run."""

    @property
    def table(self) -> Any:
        """One row: whether the two agree, compared samples, deviation, the result in words, scenario and version."""
        row = {"agrees": self.agrees, "identical": self.identical, "compared": self.compared}
        about = {} if self.scenario is None else provenance(self.scenario)
        return pa.Table.from_pylist([row | {"deviation": self.deviation, "text": self.text} | about])

    def __repr__(self) -> str:
        return f"<Replay: {self.text}>"

    @property
    def agrees(self) -> bool:
        """Whether replay and recording agree, in one sample at least."""
        return self.difference is None and self.compared > 0

    @property
    def identical(self) -> bool:
        """Whether every sample is the same, bit for bit."""
        return self.agrees and self.deviation is None


def replay(recording: Recording, seen: Callable[[float], None] = lambda time: None) -> Replay:
    """Simulate the run again and compare every signal of every recorded sample.

    Of a recording in an older format, only signals whose meaning has not changed are compared. `seen` is called with the time, s,
    up to which the two agree so far. Raises `StudyError` if the recording's commands cannot be carried out again.
    """
    found = _repeated(recording, seen)
    return replace(found, text=found.text + _other_packages(recording))


def _repeated(recording: Recording, seen: Callable[[float], None]) -> Replay:
    result = partial(Replay, scenario=recording.scenario)
    repetition, done, why = Repetition(recording), 0, _why_rounded_otherwise(recording)
    comparison = _Comparison(recording.compared, tolerant=bool(why))
    absent: frozenset[str] = frozenset()
    for recorded in recording.blocks():
        again = repetition.samples_until(float(recorded.time[-1]))
        compared, difference = _compare(recorded, again, comparison)
        done += compared
        absent |= recorded.absent
        if difference is not None:
            text = _difference_text(recording, difference, why)
            return result(done, difference, text + _why_stopped(repetition.world))
        if compared < len(recorded):
            late = float(recorded.time[compared])
            difference = Difference(late, "time", late, np.nan)
            text = f"The replay stopped at t = {late:g} s, before the recording's end."
            return result(done, difference, text + _why_stopped(repetition.world))
        seen(float(recorded.time[-1]))
    if done == 0:
        return result(0, None, "The recording has no samples: there was nothing to compare.")
    left_out = _left_out(recording, absent)
    if comparison.same_bits:
        one, many = "The only sample came out again, bit for bit.", f"All {done} samples came out again, bit for bit."
        return result(done, None, (one if done == 1 else many) + left_out)
    beyond = [each for share, each in comparison.shares() if share > TOLERANCE]
    difference = min(beyond, key=lambda each: each.time, default=None)
    if difference is not None:
        return result(done, difference, _difference_text(recording, difference, why), comparison.deviation)
    text = (
        f"All {done} samples came out again within a tolerance of {number_text(TOLERANCE)} of each signal's largest value, "
        f"by at most {number_text(comparison.deviation, 1)} of it, and not bit for bit: {why}. {_makers(recording)}{left_out}"
    )
    return result(done, None, text, comparison.deviation)


def _why_rounded_otherwise(recording: Recording) -> str:
    """A legitimate reason for different bits, as a clause; empty if there is none."""
    texts = own_texts(recording, "controller")
    if any(address_in(source) or unit_in(source, ())[0] for source in texts):
        return "its control law is computed outside of flexlab, by a program or unit that may answer differently now"
    if texts:
        return "its control law is Python code, whose rounding depends on the machine"
    if recording.properties.get("arithmetic") != ARITHMETIC:
        return "it was recorded before results were the same on every machine"
    return ""


def own_texts(recording: Recording, part: str) -> dict[str, str]:
    """Text → kind of the laws ("controller") or paths ("trajectory") in Python of a recorded run, in the order of their use."""
    first = getattr(recording.scenario, part)
    found = {first.source: first.kind} if isinstance(first, (OwnController, OwnTrajectory)) else {}
    for event in recording.events:
        changes = event.command.changes if isinstance(event.command, ChangeScenario) else {}
        source = changes.get(f"{part}.source")
        if isinstance(source, str):  # A recording may hold anything.
            found.setdefault(source, str(changes.get(f"{part}.kind", first.kind)))
    return found


def allow_own_laws(recording: Recording, agrees: Callable[[str, str, str], bool]) -> None:
    """Allow the control laws that came with a recording to run. Raises `StudyError` for one that is refused or missing.

    `agrees` takes the law's kind, a question, and the code in question, "" if there is none that a person could read.
    """
    for source, kind in own_texts(recording, "controller").items():
        if hosts.is_allowed(source):
            continue
        address, code = address_in(source), ""
        unit, unit_file = unit_in(source, (Path(), LAW_FILES.own))
        if unit and not unit_file:
            raise StudyError(
                f"The run was controlled by the unit {unit}, machine code that recordings do not hold: put that very file "
                f"here or into {LAW_FILES.own}, then replay again."
            )
        if address:
            by = f"the program at {address}, which a replay needs: it has to run there now. Connect to it?"
        elif unit:
            by = f"the unit {unit_file}, machine code that a replay needs. Let it run here?"
        else:
            code = without_data(source)
            by = f"{kind}, Python code of {len(source.splitlines())} lines that stands above. Let it run here?"
        if not agrees(kind, f"This run was controlled by {by}", code):
            raise StudyError(f"The run was not replayed: its control law {kind} was not allowed to run.")
        hosts.allow(source, address or unit_file or f"{kind.replace('-', '_')}.py")


def _left_out(recording: Recording, absent: frozenset[str]) -> str:
    """A sentence on signals of an older recording that could not be compared; empty if all were."""
    names = sorted(absent | (TABLE.keys() - recording.compared))
    if not names:
        return ""
    version = recording.properties.get("flexlab_version")
    return (
        f" It was recorded by flexlab {version} in format {recording.computed_in}: everything that both have was compared, "
        f"without {', '.join(names)}."
    )


def _compare(recorded: Samples, repeated: Iterable[Samples], so_far: "_Comparison") -> tuple[int, Difference | None]:
    """(number of compared samples, the first difference); repeated samples that were not recorded are left out."""
    done = 0
    for again in repeated:
        # The recording may have gaps, from dropped samples or a full disk.
        rows = np.searchsorted(recorded.time, again.time)
        there = (rows < len(recorded)) & (recorded.time[np.minimum(rows, len(recorded) - 1)] == again.time)
        if not there.any():
            continue
        difference = so_far.first_difference(recorded.take(rows[there]), again.take(there))
        done += int(np.count_nonzero(there))
        if difference is not None:
            return done, difference
    return done, None


class _Comparison:
    """The comparison of a run with its repetition, block by block."""

    def __init__(self, compared: frozenset[str], tolerant: bool):
        """`compared`: the signals of the table to compare; a law's own signals are all compared.

        `tolerant`: whether differences of finite numbers are only noted, as rounding.
        """
        self._compared, self._tolerant = compared, tolerant
        self.same_bits = True
        """Whether nothing has been noted."""
        self._largest: dict[str, float] = {}
        """Signal → its largest recorded value."""
        self._differences: dict[str, list[Difference]] = {}
        """Signal → its differences that exceed all earlier ones; the first beyond any bound is among them."""

    def first_difference(self, recorded: Samples, again: Samples) -> Difference | None:
        """The first difference of a block in any bit, by row and then by signal, without what is only noted."""
        present, first, found = again.signals(), len(recorded), None
        for name, values in recorded.signals().items():
            if name not in present or (name in TABLE and name not in self._compared):
                continue
            if values.shape != present[name].shape:
                sizes = math.prod(values.shape[1:]), math.prod(present[name].shape[1:])
                return Difference(float(recorded.time[0]), f"the number of values of {name}", *sizes)
            one, other = _rows(values), _rows(present[name])
            unlike = one.view(np.int64) != other.view(np.int64)
            if self._tolerant and len(one):
                self.same_bits &= not unlike.any()
                finite = np.isfinite(one) & np.isfinite(other)
                unlike &= ~finite
                self._note(name, recorded.time, np.where(finite, one, 0.0), np.where(finite, other, 0.0))
            row = int(np.argmax(unlike.any(axis=1))) if unlike.any() else first
            if row < first:
                column = int(np.argmax(unlike[row]))
                pair = float(one[row, column]), float(other[row, column])
                first, found = row, Difference(float(recorded.time[row]), name, *pair)
        return found

    def _note(self, name: str, time: np.ndarray, one: np.ndarray, other: np.ndarray) -> None:
        """Note the differences of a signal's rows (N, values), recorded and repeated, at instants (N,)."""
        self._largest[name] = max(self._largest.get(name, 0.0), float(np.abs(one).max(initial=0.0)))
        kept = self._differences.setdefault(name, [])
        most = np.abs(one - other).max(axis=1, initial=0.0)
        before = np.maximum.accumulate([abs(kept[-1].recorded - kept[-1].replayed) if kept else 0.0, *most[:-1]])
        for row in np.flatnonzero(most > before):
            column = int(np.argmax(np.abs(one[row] - other[row])))
            kept.append(Difference(float(time[row]), name, float(one[row, column]), float(other[row, column])))

    def shares(self) -> Iterator[tuple[float, Difference]]:
        """Every noted difference, with its ratio to the signal's largest value."""
        of_units: dict[tuple[str, ...], float] = {}
        units = {name: signal.units for name, signal in known_signals().items()}
        for name, largest in self._largest.items():
            key = units.get(name, (name,))
            of_units[key] = max(largest, of_units.get(key, 0.0))
        for name, differences in self._differences.items():
            alike = of_units[units.get(name, (name,))]
            largest = max(self._largest[name], AT_REST * alike, AT_REST)
            yield from ((abs(one.recorded - one.replayed) / largest, one) for one in differences)

    @property
    def deviation(self) -> float:
        """The largest such ratio."""
        return max((share for share, _ in self.shares()), default=0.0)


def _rows(signal: np.ndarray) -> np.ndarray:
    """The values of a signal (N, …) as rows, (N, values)."""
    return np.ascontiguousarray(signal.reshape(len(signal), math.prod(signal.shape[1:])))


def _difference_text(recording: Recording, difference: Difference, why: str) -> str:
    tolerance = f", beyond a tolerance of {number_text(TOLERANCE)} of the signal's largest value" if why else ""
    return (
        f"The replay differs first at t = {difference.time:g} s in {difference.signal}{tolerance}: recorded "
        f"{difference.recorded!r}, now {difference.replayed!r}. {_makers(recording)}"
    )


def _other_packages(recording: Recording) -> str:
    """A further sentence on packages of the control law whose versions are others here, or ""."""
    law = recording.scenario.controller
    try:
        recorded = json.loads(recording.properties.get(PACKAGES, "{}"))
        others = [(str(name), str(version)) for name, version in recorded.items()]
    except (TypeError, ValueError, AttributeError):  # A recording may hold anything.
        return ""
    here = packages_of(law.source) if isinstance(law, OwnController) else {}
    unlike = [
        f"{visible(name, LONGEST)} {visible(version, LONGEST)} then, {here.get(name, 'none')} now"
        for name, version in others
        if here.get(name) != version
    ]
    return f" The control law imports packages of other versions: {'; '.join(unlike[:MOST])}." if unlike else ""


def _why_stopped(world: World) -> str:
    """A further sentence on why a repetition cannot go on, or ""."""
    law = world.scenario.controller
    text = world.status.text if world.status.failed else laws()[law.kind].problem(law)
    return f" {text}" if text else ""


def _makers(recording: Recording) -> str:
    """A sentence on who recorded a run, and who replays it."""
    made, here = recording.properties, these_versions()
    return (
        f"It was recorded by flexlab {made.get('flexlab_version')} (format {recording.computed_in}) with numpy "
        f"{made.get('numpy_version')} on {made.get('machine')}, {made.get('processor', 'an unknown processor')}; this is "
        f"flexlab {here['flexlab_version']} (format {FORMAT}) with numpy {here['numpy_version']} on {here['processor']}."
    )
