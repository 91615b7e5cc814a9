"""`flexlab compare RUN RUN`: list what differs, and overlay the curves."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

from flexlab.cli.console import complain, new_table, output, print_json, tell, typed
from flexlab.cli.options import LOGS, Law, Logs, NoBrowser, Runs, Seed, Settings, ViewerPort, chosen_changes, option
from flexlab.cli.showing import show_review
from flexlab.cli.warmup import loading, warm_up
from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.analysis.comparison import Comparison


def command(
    runs: Runs = (),
    save: Annotated[
        Path | None,
        option("Write the overlay to this file instead of showing it; flexlab review opens it.", "FILE.rrd"),
    ] = None,
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    as_json: Annotated[bool, option("Print the tables as JSON and show nothing.", name="json")] = False,
    no_browser: NoBrowser = False,
    port: ViewerPort = 0,
    logs: Logs = LOGS,
) -> None:
    """Compare two to six RUNs: their settings, their metrics, and all curves in one view.

    Time is counted from each run's first sample. The other RUNs are compared with the first, A. With --set, --law or --seed, the
    first RUN's scenario is simulated again with these changes, recorded under a name that lists them, and compared as well;
    "newest" then means the newest run that was not made this way, and a changed run that exists already is not made again.
    """
    with loading():
        changes = chosen_changes(set_, law, seed)
    if len(runs) + bool(changes) < 2:
        raise StudyError("A comparison needs two runs at least: name them, as in flexlab compare newest 2026-05-01T14.")
    if save is not None and as_json:
        raise StudyError("--json prints tables and writes no overlay: give one of --json and --save.")
    if save is not None and save.suffix != ".rrd":
        raise StudyError(f"--save {save} does not name a recording: give a name that ends in .rrd.")
    with loading():
        from flexlab.analysis.comparison import compare, compare_into
        from flexlab.recording.store.run_files import NEWEST, find_run, newest_run

    paths = [find_run(run, logs) if run != NEWEST else newest_run(logs, made=not changes) for run in runs]
    if changes:
        paths.append(_changed_run(paths[0], changes, logs))
    if as_json:
        print_json(compare(paths).as_data())
        return
    with TemporaryDirectory(prefix="flexlab-") as folder:
        target = save or Path(folder) / "comparison.rrd"
        _print(compare_into(paths, target))
        if save is None:
            show_review(target, "The overlay", browser=not no_browser, port=port)
        else:
            tell(f"Written to {save}. Look at it with: flexlab review {typed(save)}")


def _changed_run(path: Path, changes: dict[str, Any], logs: Path) -> Path:
    """The recording of a run's scenario with some changes: an existing one, or a new one of the same duration."""
    with loading():
        from flexlab.analysis.result import scenario_hash
        from flexlab.cli.headless_run import run_and_record
        from flexlab.presets import telling_name
        from flexlab.recording.reader import read_recording
        from flexlab.recording.store.notes import read_notes, write_notes
        from flexlab.recording.store.run_files import VARIANT, list_runs
        from flexlab.scenario.settings import change_settings

    recording = read_recording(path)
    scenario = change_settings(recording.scenario, changes)
    begin, end = recording.span
    duration = end - begin
    if duration <= 0:
        raise StudyError(f"{path.stem} has one sample: there is nothing to compare with.")
    key = f"{path.stem} {scenario_hash(scenario)} {duration!r}"
    for run in list_runs(logs):
        if read_notes(run).get(VARIANT) == key:
            return run
    warm_up(scenario)
    name = telling_name(scenario, recording.name)
    made = run_and_record(name, scenario, duration, recording.sample_period, logs, quiet=True).path
    write_notes(made, **{VARIANT: key})
    return made


def _print(comparison: "Comparison") -> None:
    for heads, *rows in (comparison.run_table(), comparison.metric_table(), comparison.setting_table()):
        table = new_table()
        for number, head in enumerate(heads):
            table.add_column(head, justify="right" if number and heads[0] else "left", overflow="fold")
        if heads[0] == "metric":
            output().print(f"Metrics {comparison.window_text}:")
        for row in rows:
            table.add_row(*row)
        output().print(table)
        output().print()
    for sentence in comparison.coarse:
        complain(sentence)
    if not comparison.settings:
        output().print("No setting differs.")
    for label, same in comparison.repeated():
        tell(f"{label} is the same run as {same}: nothing can differ between them. flexlab logs lists the others.")
