"""Section IV: what the paper says of its simulation, and the numbers of an independent solution of the same model."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.metrics.settling_time import settling_time
from flexlab.analysis.validation.check import PERIOD, Check, Runs, above, below, close

SUBJECT, PLACE = "Section IV again", 0

REFERENCE_TOLERANCE = 5e-4
"""Relative: the independent solution is given to four digits."""


def checks(runs: Runs) -> Iterator[Check]:
    """The statements one by one, then the numbers."""
    yield from _statements(runs)
    yield from _numbers(runs)


def _rows(start: float, stop: float) -> slice:
    return slice(round(start / PERIOD), round(stop / PERIOD) + 1)


def spectrum(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes of a signal whose length holds whole periods."""
    return np.fft.rfftfreq(len(signal), PERIOD), np.abs(np.fft.rfft(signal, axis=0)) * 2 / len(signal)


def _statements(runs: Runs) -> Iterator[Check]:
    run = runs.paper
    late = np.abs(run.tracking_error[_rows(1, 6)])
    yield below(
        "“The trajectory tracks the planning trajectory quickly”: error x, y from 1 s on",
        1.0,
        1e3 * late[:, :2].max(),
        "mm",
    )
    yield below("the same: error θ from 1 s on", 0.1, 1e3 * late[:, 2].max(), "mrad")
    gone = settling_time(run.time, run.vibration)
    statement = "“At about t = 0.5 s the original vibration disappears”: below 1 % of its peak after"
    yield close(statement, 0.5, gone, "s", absolute=0.1)
    frequency, amplitude = spectrum(run.vibration[_rows(0.05, 0.45)][:-1])
    ring = float(frequency[10 + np.argmax(amplitude[10:])])
    yield close(
        "it rings with “the physical characteristic of the flexible payload”: first mode",
        44.4288,
        ring,
        "Hz",
        relative=0.08,
    )
    frequency, amplitude = spectrum(run.midspan_deflection[_rows(2, 6)][:-1])
    compelled = float(frequency[1 + np.argmax(amplitude[1:])])
    yield close(
        "“then the vibration is compelled by the rigid motion”: its frequency after 2 s",
        1.0,
        compelled,
        "Hz",
        absolute=1e-9,
    )
    share = float(np.abs(run.vibration[_rows(1, 6)]).max() / np.abs(run.midspan_deflection[_rows(1, 6)]).max())
    yield below("and the beam bends quasi-statically: what else there is of its deflection", 5e-3, share)
    window = np.hanning(300)[:, None]
    fast = []
    for signal in (run.internal_force[:, 0], run.pose):
        part = signal[_rows(0.03, 0.33)][:300]
        frequency, amplitude = spectrum((part - part.mean(axis=0)) * window)
        fast.append(float((amplitude[frequency > 20].max(axis=0) / amplitude.max(axis=0)).max()))
    yield above(
        "“the effect of vibration to internal force is more distinct than to rigid position”: by a factor of",
        30,
        fast[0] / fast[1],
    )


def _numbers(runs: Runs) -> Iterator[Check]:
    run = runs.paper
    wanted = {
        "largest error over 0 to 0.1 s": (_rows(0, 0.1), (1.674e-2, 1.704e-2, 7.005e-3)),
        "largest error over 2 to 3 s": (_rows(2, 3), (1.409e-4, 7.094e-4, 4.090e-5)),
    }
    for words, (rows, values) in wanted.items():
        found = np.abs(run.tracking_error[rows]).max(axis=0)
        for name, unit, value, here in zip("xyθ", ("m", "m", "rad"), values, found, strict=True):
            yield close(f"{words}, {name}", value, here, unit, relative=REFERENCE_TOLERANCE)
    for words, rows, value in (("0 to 0.1 s", _rows(0, 0.1), 1.770e-3), ("1 to 2 s", _rows(1, 2), 1.519e-4)):
        found = float(np.abs(run.midspan_deflection[rows]).max())
        yield close(f"largest deflection at mid-span over {words}", value, found, "m", relative=REFERENCE_TOLERANCE)
    at_start = (
        (
            "internal force of the left arm at t = 0",
            run.internal_force[0, 0],
            (-48.368, 306.939, 50.920),
            ("N", "N", "N·m"),
        ),
        ("joint torque of the left arm at t = 0", run.joint_torque[0, 0], (-638.890, 284.855, 200.605), ("N·m",) * 3),
    )
    for words, found, values, units in at_start:
        for part, unit, value, here in zip("123", units, values, found, strict=True):
            yield close(f"{words}, part {part}", value, here, unit, absolute=5e-4)
    learnt = run.bound_estimates[round(3 / PERIOD)]
    for j, value in enumerate((0.02539, 0.02095, 0.06735)):
        yield close(f"bound estimate b̂{j} at t = 3 s", value, learnt[j], absolute=5e-6)
