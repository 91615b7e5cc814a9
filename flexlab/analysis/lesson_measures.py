"""Measures of a run for lessons and explanations: frequencies, peaks, jumps; and lengths in sentences."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from flexlab.analysis.metrics import RunMetrics, run_metrics
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.metrics.vibration import settling_time
from flexlab.analysis.modes import PoleRow, fastest_growth, modes
from flexlab.physics.axial_load import buckling_load
from flexlab.recording.course import first_frequency
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, WorldCommand
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event
from flexlab.sim.target import first_mode, shaper_impulses
from flexlab.text import fixed_text

SECONDS = 30.0
"""Duration of the newest part of a run that a check sees, s."""
SETTLED, SHORTEST = 0.5, 1.5
"""Wait after a change before its ring is measured, and shortest ring that is measured, s."""
USUAL_STIFFNESS = {"bending_stiffness": 100.0}
"""EI of the paper, N·m²."""
APART = 2.0
"""Smallest difference between two squeezes that are compared, N."""
SILENT = 1e-9
"""Smallest amplitude of a ring, m; squeeze-until-it-buckles falls below it 40 s after its start."""


def ring_frequency(samples: Samples) -> float:
    """The strongest frequency of the vibration above 2 Hz, Hz."""
    return strongest_line(samples.vibration, tick(samples), 1 << 15)[0]


def strongest_line(signal: np.ndarray, period: float, padded: int) -> tuple[float, float]:
    """Frequency, Hz, and amplitude of the strongest line above 2 Hz of a signal (N,), zero-padded to `padded` samples."""
    hertz, amplitude = amplitude_spectrum(signal - signal.mean(), period, padded)
    best = int(np.argmax(np.where(hertz > 2, amplitude, 0)))
    return float(hertz[best]), float(amplitude[best])


def amplitude_spectrum(signal: np.ndarray, period: float, padded: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes of a signal (N,), windowed (Hann) and zero-padded; a sine shows its own amplitude."""
    window = np.hanning(len(signal))
    amplitude = np.abs(np.fft.rfft(signal * window, padded)) * 2 / window.sum()
    return np.fft.rfftfreq(padded or len(signal), period), amplitude


def torque_turns(samples: Samples, control_period: float) -> np.ndarray:
    """The change of each joint torque over each control period, N·m, (N, joints)."""
    stride = max(1, round(control_period / tick(samples)))
    torque = samples.joint_torque[::stride]
    return np.diff(torque.reshape(len(torque), -1), axis=0)


def torque_jump(turns: np.ndarray) -> float:
    """The largest RMS of a joint's `torque_turns`, N·m."""
    return float(np.sqrt(np.mean(turns**2, axis=0)).max()) if len(turns) else 0.0


def bound_terms(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """1, ‖x‖ and ‖ẋ‖², the terms of the bound in Theorem 2, (…, 3)."""
    size, speed = np.linalg.norm(x, axis=-1), np.linalg.norm(v, axis=-1)
    return np.stack([np.ones_like(size), size, speed**2], axis=-1)


def tick(samples: Samples) -> float:
    """The sample period, s; needs two samples or more."""
    return float(samples.time[-1] - samples.time[0]) / (len(samples) - 1)


def newest(samples: Samples, seconds: float) -> Samples:
    """The newest `seconds` of samples."""
    return between(samples, samples.time[-1] - seconds, samples.time[-1])


def largest(signal: np.ndarray) -> float:
    """The largest magnitude; 0 for an empty array."""
    return float(np.abs(signal).max()) if signal.size else 0.0


def length(metres: float) -> str:
    """A length in words: in mm, or in µm below 10 µm."""
    return f"{fixed_text(1e3 * metres, 2)} mm" if abs(metres) >= 1e-5 else f"{fixed_text(1e6 * metres, 1)} µm"


class Span(NamedTuple):
    """A part of a run without a change or touch; NaN where it is too short or no longer rings."""

    begin: float
    """First instant, s."""
    force: float = np.nan
    """Mean compression P, N."""
    frequency: float = np.nan
    """Hz."""


@dataclass(frozen=True)
class Look:
    """The data of a lesson's check: a scenario, the newest samples of a run (two or more), and all its events."""

    scenario: Scenario
    samples: Samples
    events: Sequence[Event]
    named: Mapping[str, Callable[["Look"], Any]] = field(default_factory=dict)
    """The functions that compute the values that the lesson names."""
    _values: dict[str, Any] = field(default_factory=dict, init=False)
    """These values, each computed once."""

    @cached_property
    def _metrics(self) -> RunMetrics:
        return run_metrics(self.samples)

    def value(self, name: str) -> Any:
        """The value of a name: of the lesson, of a measure, or of a metric."""
        if name in self.named:
            if name not in self._values:
                self._values[name] = self.named[name](self)
            return self._values[name]
        if name in VALUES:
            return VALUES[name](self)
        value = self._metrics[name] if "." in name else getattr(self._metrics, name)
        return float(np.max(value))

    @property
    def now(self) -> float:
        """The newest instant, s."""
        return float(self.samples.time[-1])

    def part(self, begin: float, end: float) -> Samples:
        """The samples between two instants, s."""
        return between(self.samples, begin, end)

    @property
    def touches(self) -> list[float]:
        """Instants of changes, pulls and taps, s, after which the run is not steady for a while."""
        return [event.time for event in self.events if isinstance(event.command, WorldCommand)]

    @property
    def path_rate(self) -> np.ndarray:
        """Rate of the target at the first sample, m/s, m/s, rad/s, (3,)."""
        return (self.samples.desired_pose[1] - self.samples.desired_pose[0]) / tick(self.samples)

    @cached_property
    def loop_frequency(self) -> float:
        """Damped frequency of the closed loop's first mode, Hz. Raises `FlexlabError` if there is none."""
        mode = first_mode(self.scenario)
        return float(mode.omega * np.sqrt(1 - mode.zeta**2) / (2 * np.pi))

    @cached_property
    def spans(self) -> list[Span]:
        """All spans without a change or touch, in order."""
        time = self.samples.time
        ends = [float(time[0]), *(t for t in self.touches if t > time[0]), float(time[-1])]
        return [self._span(begin, end) for begin, end in pairwise(ends)]

    def _span(self, begin: float, end: float) -> Span:
        part = self.part(begin + SETTLED, end)
        frequency = upward_frequency(part) if end - begin >= SETTLED + SHORTEST else np.nan
        return Span(begin) if np.isnan(frequency) else Span(begin, -float(part.axial_load.mean()), frequency)

    @property
    def other_span(self) -> Span:
        """The newest span whose compression differs from the present one's."""
        others = (each for each in reversed(self.spans) if abs(each.force - self.spans[-1].force) > APART)
        return next(others, Span(np.nan))


VALUES: dict[str, Callable[[Look], Any]] = {
    "t": lambda look: look.now,
    # Whether the run's first instant is seen.
    "starts": lambda look: bool(look.samples.time[0] < 0.5 * tick(look.samples)),
    "changed": lambda look: any(isinstance(event.command, ChangeScenario) for event in look.events),
    "touched": lambda look: bool(look.touches),  # changed, pulled or tapped
    "undisturbed": lambda look: look.now - max([float(look.samples.time[0]), *look.touches]),  # time since then
    "arms": lambda look: len(look.scenario.arms),
    "mode_count": lambda look: look.scenario.payload.coordinate_count,
    # Of the part of the path that is seen.
    "period": lambda look: min(look.scenario.trajectory.slowest_period, SECONDS / 2),
    "path_end": lambda look: np.nan if look.scenario.trajectory.end is None else look.scenario.trajectory.end,
    "path_speed": lambda look: float(np.linalg.norm(look.path_rate[:2])),  # at the first of the samples
    "start_jump": lambda look: float(np.linalg.norm((look.samples.pose_rate[0] - look.path_rate)[:2])),  # off the path
    "first_frequency": lambda look: first_frequency(look.scenario.payload),  # with its grips held
    "usual_frequency": lambda look: first_frequency(look.scenario.payload.model_copy(update=USUAL_STIFFNESS)),
    "shaper_delay": lambda look: float(max(shaper_impulses(look.scenario)[:, 1], default=0.0)),
    "loop_frequency": lambda look: look.loop_frequency,
    "growth": lambda look: _growth(look.scenario.anew()).rate,  # of the closed loop's fastest growing pole
    "growing_pole": lambda look: _growth(look.scenario.anew()).origin,  # its origin, as in "beam mode 3"
    "growing_frequency": lambda look: _growth(look.scenario.anew()).frequency,  # without the folding by sampling
    "buckling_load": lambda look: buckling_load(
        look.scenario.payload.length, look.scenario.payload.bending_stiffness, look.scenario.payload.boundary
    ),
    "span_start": lambda look: look.spans[-1].begin,
    "squeeze": lambda look: look.spans[-1].force,
    "squeezed_frequency": lambda look: look.spans[-1].frequency,
    "other_squeeze": lambda look: look.other_span.force,
    "other_frequency": lambda look: look.other_span.frequency,
}
"""Measures by name, SI; a span is a part of the run without a change or touch."""
OF_A_PART: dict[str, Callable[[Look, Samples], float]] = {
    "ring_frequency": lambda _, part: ring_frequency(part),
    "settled": lambda _, part: settling_time(part.time, part.vibration),  # at one per cent of its peak; NaN: not yet
    "torque_jump": lambda look, part: (  # NaN: a continuous law
        torque_jump(torque_turns(part, T_c)) if (T_c := look.scenario.controller.control_period) else np.nan
    ),
    # Sum of the arms' internal forces.
    "imbalance": lambda _, part: max(largest(part.internal_force.sum(axis=1)), 1e-15),
}
"""Measures of the samples between two instants, as in `settled(0, 1)`."""


def upward_frequency(part: Samples) -> float:
    """Frequency of a free ring, Hz, from its upward crossings of the mean; NaN without a ring."""
    w = part.midspan_deflection - part.midspan_deflection.mean()
    upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    if len(upwards) < 3 or largest(w) < SILENT:
        return np.nan
    step = part.time[1] - part.time[0]
    times = part.time[upwards] - w[upwards] * step / (w[upwards + 1] - w[upwards])
    return float((len(times) - 1) / (times[-1] - times[0]))


@lru_cache(maxsize=8)
def _growth(scenario: Scenario) -> PoleRow:
    """The fastest growing pole; cached, as the lab asks every second."""
    return fastest_growth(modes(scenario)) or PoleRow(0.0, np.nan, np.nan, "")
