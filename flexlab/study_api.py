"""Studies in Python: leaderboards, tuning, fits, comparisons, replays and exports.

Everything here is available as `flexlab.<name>`; each call does what the command of the same name does.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flexlab.analysis import comparison, tuning
from flexlab.analysis import replay as replaying
from flexlab.analysis.capsule import opened_run, write_capsule
from flexlab.analysis.comparison import Comparison
from flexlab.analysis.identification.fitting import Fit, fit_file, fit_run, is_measurement
from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import Case, chosen_cases
from flexlab.analysis.leaderboard.entry import AnyEntrant, chosen_entrants
from flexlab.analysis.leaderboard.store import FOLDER, RowStore
from flexlab.analysis.replay import Replay
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.tuning import Tuning, parse_cost
from flexlab.analysis.workers import chosen_workers, progress_bar
from flexlab.api import ARCHIVE, LOGS, PAGE, Run, export_fmu
from flexlab.arguments import file_path, flag, text_or_none, time_or_none, whole_number
from flexlab.errors import StudyError
from flexlab.files import write_text
from flexlab.presets import AnyLaw, AnyPath, AnyScenario, any_scenario, named_scenario
from flexlab.recording.export import FORMATS as TABLES
from flexlab.recording.export import export_recording
from flexlab.recording.reader import read_recording
from flexlab.recording.store.run_files import find_run
from flexlab.recording.store.run_index import RunRow, read_row, told_apart
from flexlab.scenario.field_text import change_in_words

AnyRun = Run | str | Path
"""A run; a recording's file, its name in the logs folder or the beginning of that; or "newest"."""
UNIT, BODIES = ".fmu", (".urdf", ".xml", ".mjcf")
"""Endings of files that are made of a scenario."""


def tune(
    scenario: AnyScenario,
    change: Mapping[str, str] | Sequence[str],
    cost: Sequence[str] | Mapping[str, float] = ("rms_error.x", "rms_error.y"),
    limit: Sequence[str] | Mapping[str, float] = (),
    robust: Mapping[str, Any] | Sequence[str] = (),
    duration: float = 3.0,
    candidates: int = 200,
    seed: int = 0,
    law: AnyLaw = None,
    path: AnyPath = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: bool = True,
) -> Tuning:
    """Search ranges for the parameters of least cost: `.tuned` is the scenario with them, `.table` lists all candidates.

    `change`: {"controller.feedback_gain": "50:500:log"}. `cost`: weights of metrics, {"rms_error.y": 1.0}; `limit`: largest
    allowed values, {"peak_torque": 600.0}; both in SI units. `robust`: scenarios of which the worst counts,
    {"payload.bending_stiffness": [50, 200]}. `duration`: of each run, s. `candidates`: their number, from 8 to 100000, with
    the scenario as it is; fewer if the search converges. `seed`: of the search. `law`, `path`: as in `simulate`; `workers`,
    `cluster`: as in `sweep`.
    Raises `PresetError`, `ScenarioError` or `StudyError`.
    """
    _, valid = named_scenario(scenario, law, path)
    axes = parse_axes(change, valid, "change")
    none = robust is None or (isinstance(robust, (Sequence, Mapping)) and not robust)
    others = () if none else parse_axes(robust, valid, "robust")
    known = chosen_workers(workers, cluster)
    with progress_bar(progress, "candidates") as told:
        return tuning.tune(valid, axes, parse_cost(cost, limit), others, duration, candidates, seed, told, known)


def fit(
    source: AnyRun,
    signal: str | None = None,
    time: str | None = None,
    start: float | None = None,
    end: float | None = None,
    scenario: AnyScenario | None = None,
    logs: str | Path = LOGS,
) -> Fit:
    """Fit a free vibration: `.ring.modes` with 95 % intervals and the `.beam` that fits; `.is_ring` says whether there is one.

    `source`: a run, or a CSV file; `time` and `signal` name its columns, with a unit, as in "laser [mm]". `start`, `end`: the
    span, s; by default it begins where the ring does. `scenario`: what is known of the beam; None for a run's own. The beam of a
    file rings between fixed ends, as in a vice; a run's rings in its control loop. Raises `StudyError`, `RecordingError`.
    """
    of, column = text_or_none("signal", signal, "vibration"), text_or_none("time", time, "time")
    known = None if scenario is None else any_scenario(scenario)
    if isinstance(source, (str, Path)) and is_measurement(str(file_path("source", source))):
        return fit_file(Path(source), column, of, start, end, known)
    with ExitStack() as stack:
        (path,) = _paths([source], logs, stack)
        return fit_run(str(path), path.parent, column, of, start, end, known)


def compare(*runs: AnyRun, logs: str | Path = LOGS) -> Comparison:
    """Compare two or more runs over the duration of the shortest that finished: differences in settings and in metrics.

    Raises `RecordingError` and `StudyError`.
    """
    if len(runs) < 2:
        raise StudyError("A comparison needs two runs at least.")
    with ExitStack() as stack:
        return comparison.compare(_paths(runs, logs, stack))


def replay(run: AnyRun, logs: str | Path = LOGS, run_own_law: bool = False) -> Replay:
    """Simulate a run, a recording or an archive (.zip) again from its start and its commands, and compare every bit.

    `run_own_law` allows Python code that came with the recording to run. Raises `RecordingError` and `StudyError`.
    """
    may_run = flag("run_own_law", run_own_law)

    def agrees(kind: str, *_: str) -> bool:
        if not may_run:
            raise StudyError(f"The run came with the control law {kind}, Python code: let it run by run_own_law=True.")
        return True

    with ExitStack() as stack:
        is_archive = not isinstance(run, Run) and str(run).lower().endswith(ARCHIVE)
        path = stack.enter_context(opened_run(str(run), Path())) if is_archive else _paths([run], logs, stack)[0]
        recording = read_recording(path)
        replaying.allow_own_laws(recording, agrees)
        return replaying.replay(recording)


def export(
    what: AnyRun | AnyScenario,
    to: str | Path,
    start: float | None = None,
    end: float | None = None,
    logs: str | Path = LOGS,
    **options: Any,
) -> Path:
    """Write a run as a table (.csv, .parquet, .npz), a page (.html) or an archive (.zip); returns the file.

    Or write a scenario for other simulators: .fmu (`options` as for `export_fmu`), .urdf, .xml or .mjcf. `start`, `end`: span of
    a table, s. Raises `RecordingError`, `StudyError` and, for a scenario, `PresetError` or `ScenarioError`.
    """
    target = file_path("to", to)
    kind = target.suffix.lower()
    first, last = time_or_none("start", start), time_or_none("end", end)
    known = (*TABLES, PAGE, ARCHIVE, UNIT, *BODIES)
    if kind not in known:
        raise StudyError(f"{target} has no known format: let its name end in {', '.join(known)}.")
    of_scenario = kind in (UNIT, *BODIES)
    if kind not in TABLES and (first, last) != (None, None):
        what_whole = "scenario" if of_scenario else "run"
        raise StudyError(f"start and end are for tables: {target} holds the whole {what_whole}.")
    _check_options(options, kind == UNIT, target)
    if of_scenario:
        if isinstance(what, Run):
            what = what.scenario
        if kind == UNIT:
            return export_fmu(what, target, **options)
        from flexlab.multibody import write_bodies

        name, scenario = named_scenario(what)
        return write_bodies(scenario, target, name)
    if not isinstance(what, (Run, str, Path)):
        raise StudyError(f"{target} is made of a run: give one, or simulate the scenario first.")
    with ExitStack() as stack:
        (path,) = _paths([what], logs, stack)
        if kind == ARCHIVE:
            write_capsule(path, target)
        elif kind == PAGE:
            write_page(read_row(path), target)
        else:
            export_recording(read_recording(path), target, first, last)
    return target


def _check_options(options: Mapping[str, Any], of_unit: bool, target: Path) -> None:
    known = ("part", "version", "sample_period")  # of `export_fmu`
    if unknown := [name for name in options if name not in known]:
        there = f"there are start, end and logs, and for units {', '.join(known)}"
        raise StudyError(f"{', '.join(unknown)}: export has no such option: {there}.")
    if options and not of_unit:
        raise StudyError(f"{', '.join(options)}: an option of units is of no use here: let {target} end in .fmu.")


def write_page(row: RunRow, target: Path) -> None:
    """Write a recorded run as one page, with its notes, lessons and changes. Raises `StudyError`."""
    from flexlab.lab.run_page import Noted, run_page

    recording = read_recording(row.path)
    heading = told_apart([row], row.path.parent)[0].heading  # Two people of the same name hand in one sheet each.
    noted = Noted(heading, row.note, row.lessons, tuple(map(change_in_words, row.changes)))
    write_text(target, run_page(recording.run, recording.name, noted, recording.events))


def _paths(runs: Sequence[AnyRun], logs: str | Path, stack: ExitStack) -> list[Path]:
    """Paths of the runs' recordings; a run in memory is recorded until `stack` closes. Raises `RecordingError`, `StudyError`."""
    folder = file_path("logs", logs)
    if odd := [run for run in runs if not isinstance(run, (Run, str, Path))]:
        raise StudyError(
            f"{odd[0]!r:.60} is not a run: give one from flexlab.simulate, or the name or path of a recording."
        )
    return [
        run.save(stack.enter_context(TemporaryDirectory(prefix="flexlab-")))
        if isinstance(run, Run)
        else find_run(str(run), folder)
        for run in runs
    ]


def leaderboard(
    laws: Sequence[AnyEntrant] | None = None,
    cases: Sequence[str | Case] | None = None,
    more_laws: Sequence[AnyEntrant] = (),
    long: bool = False,
    seed: int = 0,
    folder: str | Path = FOLDER,
    workers: int | None = None,
    cluster: str | None = None,
    progress: bool = True,
) -> Leaderboard:
    """Simulate control laws in the benchmark's cases, and collect their scores in a table.

    `laws`: names, paths of Python files, or subclasses of `OwnLaw`; None for flexlab's own, to which `more_laws` are added.
    `cases`: names, B1 to B8; None for all, B7 only with `long`. `folder` keeps every row under a hash of scenario, law and
    engine, so that only what changed is computed again. `workers`: number of threads, None for one per core; or `cluster`: the
    address of a Dask scheduler. A law that fails says why in its row. Raises
    `StudyError` for unusable arguments and `ScenarioError` for an unusable file of a law.
    """
    known = chosen_workers(workers, cluster)
    tasks = make_tasks(
        chosen_cases(cases, flag("long", long)), chosen_entrants(laws, more_laws), whole_number("seed", seed, 0)
    )
    with progress_bar(progress, "rows") as told:
        return run_board(tasks, RowStore(file_path("folder", folder)), known, told)
