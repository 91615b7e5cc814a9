"""`flexlab run PRESET`: simulate without a screen, record, print a summary."""

from typing import Annotated

from flexlab.cli.console import print_json
from flexlab.cli.options import LOGS, Law, Logs, PathChoice, Presets, Seed, Settings, option
from flexlab.cli.warmup import loading
from flexlab.errors import StudyError
from flexlab.text import range_text

LONGEST_DURATION = 1e6  # s


def command(
    preset: Presets,
    duration: Annotated[float, option("Simulated time, s.", "S", default=None)] = 3.0,
    sample_period: Annotated[float, option("Time between samples, s.", "S", default=None)] = 0.001,
    set_: Settings = (),
    law: Law = None,
    path: PathChoice = None,
    seed: Seed = None,
    as_json: Annotated[
        bool, option("Print a JSON list, one object per run with all digits (SI).", name="json")
    ] = False,
    logs: Logs = LOGS,
) -> int:
    """Simulate each PRESET without a screen, as fast as the machine allows, record it and print a summary."""
    with loading():
        from flexlab.sim.snapshot import LONGEST_PERIOD, SHORTEST_PERIOD

        # Check the period first: it is the shortest duration.
        _check("sample-period", sample_period, SHORTEST_PERIOD, LONGEST_PERIOD)
        _check("duration", duration, sample_period, LONGEST_DURATION)
        from flexlab.cli.options import chosen_scenarios

        scenarios = chosen_scenarios(preset, set_, law, seed, path)
        from flexlab.cli.headless_run import run_and_record
        from flexlab.cli.warmup import warm_up
        from flexlab.recording.store.run_files import check_folder

    check_folder(logs)
    warm_up(scenarios[0][1])
    ended = [run_and_record(name, scenario, duration, sample_period, logs, as_json) for name, scenario in scenarios]
    if as_json:
        print_json([run.as_json() for run in ended])
    return 1 if any(run.status.failed for run in ended) else 0


def _check(option: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise StudyError(f"--{option} {value:g} is not usable: give a number of seconds from {range_text(low, high)}.")
