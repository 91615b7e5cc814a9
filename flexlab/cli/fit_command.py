"""`flexlab fit`: frequency, damping and stiffness of a beam from how it rings."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import tyro

from flexlab.cli.console import note, output, print_json
from flexlab.cli.options import LOGS, Logs
from flexlab.errors import StudyError

if TYPE_CHECKING:
    import numpy as np

    from flexlab.scenario import Scenario

UNTOLD = "paper"
"""The preset whose beam a measurement is held against that names none."""


def command(
    source: tyro.conf.Positional[
        Annotated[str, tyro.conf.arg(metavar="RUN|FILE.csv", help="A recording, or a CSV file of your own.")]
    ],
    signal: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="NAME", help="Column with its unit, as in 'laser [mm]'; of a run, a signal.", help_behavior_hint=""
        ),
    ] = None,
    time: Annotated[
        str | None,
        tyro.conf.arg(metavar="NAME", help="Column of time with its unit, as in 't [ms]'.", help_behavior_hint=""),
    ] = None,
    start: Annotated[
        float | None,
        tyro.conf.arg(
            metavar="S", help="Where the free ring begins, s; of a run, its last tap.", help_behavior_hint=""
        ),
    ] = None,
    end: Annotated[float | None, tyro.conf.arg(metavar="S", help="Where it ends, s.", help_behavior_hint="")] = None,
    preset: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="PRESET", help="What is known of the beam: length, density, boundary.", help_behavior_hint=""
        ),
    ] = None,
    save: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE.json", help="Write the scenario with what was found.", help_behavior_hint=""),
    ] = None,
    as_json: Annotated[
        bool, tyro.conf.arg(name="json", help="Print JSON with all digits.", help_behavior_hint="")
    ] = False,
    logs: Logs = LOGS,
) -> int:
    """Fit a free vibration: each mode's frequency and damping ratio with 95 % intervals, and the beam that rings so.

    A CSV file of deflections, taken to be at mid-span, becomes a run in logs, which flexlab compare lays over
    simulations. Says "not identifiable" where the samples do not tell. Exits with 1 if the first frequency is not.
    """
    from flexlab.analysis.identification.beam_parameters import beam_parameters
    from flexlab.analysis.identification.ring import fit_ring
    from flexlab.presets import find_scenario, save_scenario

    measured = source.lower().endswith(".csv")
    scenario = find_scenario(preset)[1] if preset else None
    if measured:
        t, y, unit = _from_file(Path(source), time, signal, start, end)
    else:
        t, y, unit, recorded = _from_run(source, signal, start, end, logs)
        scenario = scenario or recorded
    fit = fit_ring(t, y)
    kept = _kept(Path(source), preset, scenario, (t, y, fit.background), unit, logs) if measured else None
    rows: dict[str, Any] = {}
    for number, mode in enumerate(fit.modes, start=1):
        rows[f"f{number}"], rows[f"ζ{number}"] = mode.frequency, mode.damping_ratio
    if scenario is not None:
        found = beam_parameters(fit, scenario, in_loop=not measured)
        rows |= {"EI": found.bending_stiffness, "ρ": found.linear_density, found.damping_field: found.damping}
        if save is not None:
            save_scenario(found.scenario, save)
    elif save is not None:
        raise StudyError("--save needs --preset: the scenario whose beam is fitted.")
    if as_json:
        plain: dict[str, Any] = {
            name: {**vars(value), "identifiable": value.identifiable} for name, value in rows.items()
        }
        data = {"samples": fit.samples, "noise": fit.noise, "run": kept and kept.stem, **_without_nan(plain)}
        print_json(json.dumps(data, indent=1, ensure_ascii=False))
    else:
        span = f"{fit.samples} samples from t = {fit.start:.6g} s to {fit.end:.6g} s"
        output().print(f"{span}, noise {fit.noise:.3g} {unit}", soft_wrap=True)
        for name, value in rows.items():
            output().print(f"  {name:<4} {value}", soft_wrap=True)
        if save is not None:
            output().print(str(save), soft_wrap=True)
        if kept is not None:
            run = kept.stem if logs == LOGS else kept
            said = f"Kept in {kept}. Beside a simulation: flexlab compare {run} RUN"
            output().print(said, soft_wrap=True)
    return 0 if fit.first.frequency.identifiable else 1


def _without_nan(data: Any) -> Any:
    if isinstance(data, dict):
        fields = cast("dict[str, Any]", data)
        return {name: _without_nan(value) for name, value in fields.items()}
    return None if isinstance(data, float) and data != data else data


def _from_file(
    path: Path, time: str | None, signal: str | None, start: float | None, end: float | None
) -> "tuple[np.ndarray, np.ndarray, str]":
    from flexlab.analysis.identification.beam_parameters import read_measured

    found = read_measured(path, time, signal)
    for sentence in found.notes:
        note(sentence)
    return *_window(found.time, found.signal, start, end), found.unit


def _kept(
    source: Path,
    preset: str | None,
    scenario: "Scenario | None",
    data: "tuple[np.ndarray, np.ndarray, np.ndarray]",
    unit: str,
    logs: Path,
) -> Path | None:
    """The run that a measurement is kept as; None, with a word on why, if it is not."""
    from flexlab.analysis.run_summary import note_metrics
    from flexlab.errors import RecordingError
    from flexlab.presets import load_preset
    from flexlab.recording.importing import take_measurement

    if unit != "m":
        note(f"{source.name} is not kept as a run: {unit or 'a number without a unit'} is no deflection.")
        return None
    t, y, rest = data
    held = scenario or load_preset(UNTOLD)
    what = f"{len(t)} deflections from {source.name}, held against {preset or UNTOLD}"
    try:
        path = take_measurement(source, held, t, y, rest, what, logs)
        note_metrics(path)
    except RecordingError as error:
        note(f"{source.name} is not kept as a run: {error}")
        return None
    return path


def _from_run(
    source: str, signal: str | None, start: float | None, end: float | None, logs: Path
) -> "tuple[np.ndarray, np.ndarray, str, Scenario]":
    from flexlab.analysis.identification.ring import ring_of_run
    from flexlab.recording.reader import read_recording
    from flexlab.recording.store.run_files import find_run

    recording = read_recording(find_run(source, logs))
    t, y, unit = ring_of_run(recording, signal or "vibration", start, end)
    return t, y, unit, recording.scenario


def _window(
    t: "np.ndarray", y: "np.ndarray", start: float | None, end: float | None
) -> "tuple[np.ndarray, np.ndarray]":
    inside = (t >= (t[0] if start is None else start)) & (t <= (t[-1] if end is None else end))
    if not inside.any():
        raise StudyError(
            f"There are no samples from {start} to {end} s: the data last from {t[0]:.6g} to {t[-1]:.6g} s."
        )
    return t[inside], y[inside]
