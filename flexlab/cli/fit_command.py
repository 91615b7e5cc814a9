"""`flexlab fit RUN`: frequency, damping and stiffness of a ringing beam."""

from pathlib import Path
from typing import Annotated, Any, cast

import tyro

from flexlab.cli.console import note, print_json, tell, typed
from flexlab.cli.options import LOGS, Logs, check_scenario_file, option
from flexlab.cli.warmup import loading
from flexlab.errors import RecordingError, StudyError


def command(
    source: tyro.conf.Positional[
        Annotated[str, option("A recording, or a CSV file of your own.", "RUN|FILE.csv", default=None)]
    ],
    signal: Annotated[
        str | None, option("Column with its unit, as in 'laser [mm]', or a run's signal.", "NAME")
    ] = None,
    time: Annotated[str | None, option("Time column with its unit, as in 't [ms]'.", "NAME")] = None,
    start: Annotated[
        float | None, option("Start of the free vibration, s. (default: found; in a run, its last tap)", "S")
    ] = None,
    end: Annotated[float | None, option("End of the free vibration, s.", "S")] = None,
    preset: Annotated[
        str | None, option("Scenario with what is known of the beam: length, density, boundary.", "PRESET")
    ] = None,
    save: Annotated[Path | None, option("Write the scenario with the fitted beam.", "FILE.json")] = None,
    as_json: Annotated[bool, option("Print JSON with all digits.", name="json")] = False,
    logs: Logs = LOGS,
) -> int:
    """Fit a free vibration: each mode's frequency and damping ratio with 95 % intervals, and the beam that fits.

    A CSV file of deflections, taken to be at mid-span, becomes a run in logs, which flexlab compare overlays with
    simulations. Prints "no ring" if the samples hold no free vibration, and "not identifiable" for a value that they do not
    determine. Exits with 1 if the first frequency is not identifiable.
    """
    with loading():
        from flexlab.analysis.identification.fitting import fit_file, fit_run, is_measurement, keep_measurement
        from flexlab.presets import find_scenario, save_scenario

    path = Path(source)
    measured = is_measurement(source)
    if save is not None:
        if measured and not preset:
            raise StudyError("--save needs --preset: the scenario whose beam is fitted.")
        check_scenario_file(save)
    scenario = find_scenario(preset)[1] if preset else None
    how = time, signal, start, end, scenario
    fit = fit_file(path, *how) if measured else fit_run(source, logs, *how)
    for sentence in fit.notes:
        note(sentence)
    kept = None
    if measured:
        try:
            kept = keep_measurement(fit, path, scenario, preset, logs)
        except RecordingError as error:
            note(f"{path.name} is not kept as a run: {error}")
    if save is not None and fit.scenario is not None:
        save_scenario(fit.scenario, save)
    if as_json:
        print_json(_without_nan(fit.as_data() | {"run": kept and kept.stem}))
    else:
        tell(fit, *([] if save is None else [save]))
        if kept is not None:
            run = kept.stem if logs == LOGS else kept
            tell(f"Kept in {kept}. Beside a simulation: flexlab compare {typed(run)} RUN")
    return 0 if fit.ring.first.frequency.identifiable else 1


def _without_nan(data: Any) -> Any:
    if isinstance(data, dict):
        fields = cast("dict[str, Any]", data)
        return {name: _without_nan(value) for name, value in fields.items()}
    return None if isinstance(data, float) and data != data else data
