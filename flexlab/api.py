"""The Python interface: simulate scenarios, read recordings, and work with runs.

Everything here is available as `flexlab.<name>`. Calls import what only they need, so that a first simulation does not wait
for the libraries of recordings and figures.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.analysis.metrics import RunMetrics, run_metrics
from flexlab.analysis.metrics.own import OwnMetric, own_metrics
from flexlab.analysis.metrics.run_metrics import Noted
from flexlab.analysis.result import result_hash
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.sweep.plan import DEFAULT_ACCURACY, MANY_CELLS, make_plan
from flexlab.analysis.sweep.result import Sweep, run_sweep, sweep_folder
from flexlab.analysis.workers import chosen_workers, progress_bar
from flexlab.analysis.workers import simulate_many as compute_many
from flexlab.arguments import file_path, flag, whole_number
from flexlab.errors import RecordingError, StudyError
from flexlab.presets import AnyLaw, AnyPath, AnyScenario, law_and_path, named_scenario
from flexlab.recording.course import Course, course_of_commands
from flexlab.recording.table_columns import table_columns, to_columns
from flexlab.sim import samples
from flexlab.sim import simulate as engine
from flexlab.sim.commands import WorldCommand
from flexlab.text import counted

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from flexlab.analysis.explanations.explanation import Explained
    from flexlab.text import Page

LOGS = "logs"
"""The folder of recordings, relative to the working directory."""
PAGE, ARCHIVE = ".html", ".zip"
"""Endings of files that `export` writes of a run, besides tables."""


class Run(samples.Run):  # noqa: D101  (help shows what it inherits: a table of all arrays)
    name: str
    """The preset or file that the scenario came from; it names recordings."""

    # Help lists what is annotated, private or not.
    if TYPE_CHECKING:
        _noted: Mapping[str, float | None]
        """Own metrics that were stored with a recording, in SI units, by title and unit."""

        _measured: tuple[list[OwnMetric], RunMetrics] | None
        """The own metrics that were declared when the metrics were computed, and all metrics; None if not computed yet."""

        _course: Course | None
        """How the run went, for the replay of its recording; None if from its scenario's start, without commands."""

    # Every public name here must be in `sim.samples.TAKEN`, so that no signal of a law can have it.
    def __init__(self, *, name: str = "run", **parts: Any):
        super().__init__(**parts)
        vars(self).update(name=name, _noted={}, _measured=None, _course=None)

    @property
    def metrics(self) -> RunMetrics:
        """Metrics of the whole run in SI units: tracking errors, vibration, settling time, torques…; `print` shows a table.

        All but the duration are NaN for a run that stopped before its end. Your own metrics (`flexlab.metric`) that were stored
        with a recording are included. Raises `StudyError` if one of your own fails.
        """
        declared = own_metrics()
        if self._measured is None or self._measured[0] != declared:
            found = run_metrics(self, finished=not self.status.failed, noted=self._noted)
            vars(self).update(_measured=(declared, found))
            return found
        return self._measured[1]

    @cached_property
    def explanations(self) -> tuple["Explained", ...]:
        """Sentences about the run's last five seconds, as from `explain(run)`."""
        return explain(self)

    @property
    def result_hash(self) -> str:
        """16 digits that identify the samples, bit for bit, as `flexlab run` prints them."""
        return result_hash(self)

    def save(self, folder: str | Path = LOGS) -> Path:
        """Record the run as `<folder>/<time>-<name>.rrd`, or as a file that you name; returns the path.

        `run.save("squeezed.rrd")` names the file. The commands of the run are recorded, so that it can be replayed. Its metrics,
        your own included, are stored beside it; if one of your own fails, the run's note says so. `flexlab review`, the lab's
        library and `flexlab.read` open it again. Raises `RecordingError`, also if the file exists already.
        """
        from flexlab.analysis.run_summary import MetricNotes
        from flexlab.recording.export import FORMATS
        from flexlab.recording.headless import write_run
        from flexlab.recording.store.notes import write_notes

        place, problem, metrics = file_path("folder", folder), "", None
        # `Path.is_dir` raises an error for a name that is too long.
        if place.suffix.lower() in (*FORMATS, PAGE, ARCHIVE) and not os.path.isdir(place):
            raise RecordingError(f"{place} is no recording (.rrd): flexlab.export(run, '{place}') writes such a file.")
        try:
            if own_metrics() or self._noted:  # All others are gathered while the run is written.
                metrics = self.metrics
        except StudyError as error:
            problem = str(error)
        notes = MetricNotes(self.name, self.scenario, metrics)
        path = write_run(self, place, self.name, notes, self._course)
        if problem:
            write_notes(path, note=problem)
        return path

    def plot(self, *signals: str) -> "Figure":
        """A matplotlib figure of signals by name in SI units, as in `run.plot("joint_torque", "vibration")`.

        Without names it shows the lab's plots. Raises `StudyError` for a name that is not a signal.
        """
        from flexlab.analysis.figures import draw_signals

        return draw_signals(self, signals)

    def show(self) -> "Page":
        """A page for notebooks with the run in three dimensions and plots of its signals; it needs no network.

        It shows the scenario with which the run started. Raises `StudyError` for a run without samples.
        """
        from flexlab.lab.run_page import run_page
        from flexlab.text import Page

        return Page(run_page(self, self.name, events=self._course.events if self._course else ()))

    def to_arrow(self) -> Any:
        """All signals as an Arrow table, a row per instant, with units in the columns' names, as `flexlab export` writes it."""
        import pyarrow

        return pyarrow.table(to_columns(self, table_columns(self.scenario)))

    def to_pandas(self) -> "pandas.DataFrame":
        """All signals as a pandas data frame. Raises `StudyError` if pandas is not installed."""
        try:
            return self.to_arrow().to_pandas()
        except ImportError:
            raise StudyError("pandas is not installed: pip install pandas brings it, or use to_arrow().") from None

    def to_xarray(self) -> "xarray.Dataset":
        """All signals as an xarray dataset with named axes and units in `attrs`: `run.to_xarray().joint_torque.sel(arm="left")`.

        Raises `StudyError` if xarray is not installed.
        """
        from flexlab.recording.export import to_dataset

        return to_dataset(self)

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>{self.metrics._repr_html_()}"

    def __repr__(self) -> str:
        span = f", t = {self.time[0]:g} s to {self.time[-1]:g} s" if len(self) else ""
        why = " ".join(self.status.text.split())
        if self.status.failed:
            how = f"did not finish ({self.status}: {why})"
        else:  # After the first sentence come warnings.
            warned = why.partition(" s. ")[2]
            how = f"{self.status} ({warned})" if warned else str(self.status)
        return f"<Run of {self.name}: {how}, {counted(len(self), 'sample')}{span}>"


Run.__doc__ = samples.Run.__doc__


def simulate(
    scenario: AnyScenario,
    duration: float = 3.0,
    sample_period: float = 0.001,
    commands: Sequence[tuple[float, WorldCommand]] = (),
    law: AnyLaw = None,
    path: AnyPath = None,
    check: bool = False,
) -> Run:
    """Simulate a scenario for `duration` s, with a sample at exactly every k · `sample_period` s, t = 0 included.

    `scenario`: a `Scenario`, the name of a preset, the path of a scenario file, or plain data. `commands`: (time in s, command)
    pairs, as a person in the live lab would give them, with a `Tap`, `Pull` or `ChangeScenario` of `flexlab.sim.commands`; each
    takes effect at the first sample at or after its time. `law`: another control law, by its name, the path of a Python file or
    unit (.fmu) that holds one, the address of a program (tcp://HOST:PORT), or a subclass of `OwnLaw`; `path`: another path, by
    its name, a CSV file, a Python file, or a subclass of `OwnPath`. A run that cannot start or go on ends early: `run.status`
    says why, and the good samples are kept. Raises `PresetError` or `ScenarioError` for an invalid scenario or command, and
    `StudyError` for an invalid duration or period, a command that changes the beam's mesh or restarts the run, and, with
    `check`, a run that did not finish.
    """
    must_finish = flag("check", check)
    name, valid = named_scenario(scenario, law, path)
    simulated = engine.simulate(valid, duration, sample_period, commands)
    run = _run(simulated, name, course=course_of_commands(simulated, commands, sample_period))
    if must_finish and run.status.failed:
        raise StudyError(f"The run of {name} did not finish: {run.status.text}")
    return run


def explain(run: Run) -> tuple["Explained", ...]:
    """Sentences about the last five seconds of a run, the most important first, each with its equation and plot.

    They follow from the samples since the last change or touch, and from the poles and conditions of the scenario at the end; a
    sentence whose check fails is left out. There are none while somebody pulls the beam or an arm, or while the payload's
    mass changes.
    """
    if not isinstance(run, samples.Run):
        raise StudyError(f"{run!r:.60} is not a run: give one from flexlab.simulate or flexlab.read.")
    from flexlab.analysis.explanations.explanation import explain_run

    course = getattr(run, "_course", None)
    return explain_run(run, run.scenario, events=course.events if course else ())


def simulate_many(
    scenarios: Sequence[AnyScenario],
    duration: float = 3.0,
    sample_period: float = 0.001,
    workers: int | None = None,
    progress: bool = True,
    law: AnyLaw = None,
    path: AnyPath = None,
    cluster: str | None = None,
) -> list[Run]:
    """Simulate many scenarios on all cores, each as `simulate` does, with one law or path; the runs are in the same order.

    `workers`: number of threads, None for one per core; or `cluster`: the address of a Dask scheduler.

    An invalid scenario becomes a run without samples whose status is "invalid" and says why; a run that cannot go on ends
    early, as in `simulate`. `progress` draws a bar on a terminal. Raises `PresetError` for an unknown name, `ScenarioError`
    for an unusable law or path, and `StudyError` for other unusable arguments.
    """
    single = isinstance(scenarios, (str, bytes, Mapping)) or (isinstance(scenarios, np.ndarray) and not scenarios.ndim)
    if single or not isinstance(scenarios, Iterable):
        raise StudyError(f"scenarios = {scenarios!r:.60} is not a list: give scenarios, as in ['paper', 'soft-beam'].")
    pairs = [("run", scenario) if isinstance(scenario, Mapping) else named_scenario(scenario) for scenario in scenarios]
    choose = law_and_path(law, path)
    names, chosen = [name for name, _ in pairs], [scenario for _, scenario in pairs]
    runs = compute_many(chosen, duration, sample_period, workers, progress, choose, cluster)
    return [_run(run, name) for name, run in zip(names, runs, strict=True)]


def sweep(
    scenario: AnyScenario,
    vary: Mapping[str, Any] | Sequence[str],
    duration: float = 3.0,
    sample_period: float = 0.001,
    design: str = "grid",
    samples: int | None = None,
    seed: int = 0,
    accuracy: float | None = DEFAULT_ACCURACY,
    folder: str | Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: bool = True,
    most_cells: int = MANY_CELLS,
    law: AnyLaw = None,
    path: AnyPath = None,
) -> Sweep:
    """Simulate a scenario with fields varied over ranges, on all cores, and gather the metrics of every cell in a table.

    `vary`: {"payload.bending_stiffness": "1:1000:log:25", "controller.kind": ["pd", "computed-torque"]}, or the same as on
    the command line, ["payload.bending_stiffness=1:1000:log:25"]; a law or path may be given by its file or class.
    `law`, `path`: as in `simulate`. `design`: "grid" (all combinations), or
    "latin-hypercube" or "sobol" with a number of `samples` and a `seed`. `accuracy`: pose accuracy of the runs, m; None for the
    scenario's own. `folder` (None: `sweeps/<name>-<key>`) keeps the table; an interrupted sweep continues there, and the
    same sweep is not computed twice. `workers`: number of threads, None for one per core; or `cluster`: the address of a Dask
    scheduler. A cell that fails says why and does not stop the others. Raises `PresetError` or `ScenarioError` for the scenario
    and `StudyError` for other unusable arguments, for a cluster that fails, and for more than `most_cells` cells.
    """
    name, valid = named_scenario(scenario, law, path)
    most = whole_number("most_cells", most_cells, 1)
    plan = make_plan(valid, parse_axes(vary, valid), duration, sample_period, design, samples, seed, accuracy)
    if plan.cell_count > most:
        raise StudyError(f"The sweep has {plan.cell_count} cells: say most_cells={plan.cell_count} if you mean it.")
    known = chosen_workers(workers, cluster)
    place = sweep_folder(name, plan) if folder is None else file_path("folder", folder)
    with progress_bar(progress) as told:
        return run_sweep(plan, place, known, told)


def read(run: str | Path, logs: str | Path = LOGS) -> Run:
    """A recorded run, bit for bit. `run` is a file, a run's name in `logs` or the beginning of one, or "newest".

    The scenario is that of the first sample. Raises `RecordingError` if there is no such recording or it cannot be read.
    """
    if not isinstance(run, (str, Path)):
        raise StudyError(f"read({run!r:.60}) names no recording: give a file's path, a run's name, or \"newest\".")
    from flexlab.recording.headless import course_of_recording
    from flexlab.recording.reader import read_recording
    from flexlab.recording.store.run_files import find_run
    from flexlab.recording.store.run_index import read_row

    path = find_run(str(run), file_path("logs", logs))
    recording, row = read_recording(path), read_row(path)
    noted = {key: row.metrics[key] for key in row.own_metrics if key in row.metrics}
    return _run(recording.run, recording.name, noted, course_of_recording(recording))


def export_fmu(
    scenario: AnyScenario, file: str | Path, part: str = "plant", version: int = 3, sample_period: float = 0.001
) -> Path:
    """Write a scenario as a functional mock-up unit (.fmu), which other tools simulate without Python; returns the file.

    `part`: "plant" is arms and beam, with the motor torques as inputs; "law" is law and path, with the measurements as inputs;
    "loop" is both together, with the same bits as `simulate`; "follower" is the loop without its path, with the desired motion
    as input. `version`: of FMI, 3 or 2. Importers step by `sample_period` s or by multiples of it. A C compiler is needed.
    Raises `PresetError`, `ScenarioError` or `StudyError`.
    """
    from flexlab.files import check_writing
    from flexlab.fmi import write_fmu

    target = file_path("file", file)
    check_writing(target, ".fmu")
    name, known = named_scenario(scenario)
    write_fmu(known, target, name, part, version, sample_period)
    return target


def _run(run: samples.Run, name: str, noted: Noted = None, course: Course | None = None) -> Run:
    made = Run(**run.signals(), scenario=run.scenario, status=run.status, name=name)
    vars(made).update(_noted=noted or {}, _course=course)
    return made
