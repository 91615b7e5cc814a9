"""The beam's ring as tones for browsers whose sound is on: the scaled frequency and the loudness of each mode.

All frequencies are scaled by one factor, which keeps their ratios; `hear.js` makes the sound.
"""

import json
import math

import numpy as np
import viser

from flexlab.lab.look_back import LookBack
from flexlab.lab.mode_computation import peak_deflection
from flexlab.lapack import one_blas_thread
from flexlab.numerics.linear_algebra import product
from flexlab.scenario import Payload
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK, Snapshot

FACTOR, STEP = 16.0, 4.0
"""The usual factor, which makes the paper's 45 Hz audible at 714 Hz, and its step for beams that need another factor."""
LOWEST, HIGHEST = 50.0, 2500.0
"""Range of the first mode's tone, Hz."""
TOP = 12_000.0
"""Highest tone, Hz: few people hear, and few loudspeakers play, the tones of higher modes."""
SILENT, LOUDEST = 1e-6, 1e-2
"""Amplitudes at the mode's antinode, m: up to the first it is silent, from the second on it has full loudness."""
SHORTEST, LONGEST = 0.005, 0.3
"""Limits, s, of the window whose largest amplitude counts: a period of the first mode."""
MOST_TONES = 8


def heard_factor(first_frequency: float) -> float:
    """The factor on all frequencies that makes a first mode of `first_frequency` Hz audible."""
    factor = FACTOR
    while factor * first_frequency < LOWEST:
        factor *= STEP
    while factor * first_frequency > HIGHEST:
        factor /= STEP
    return factor


def loudness(amplitude: float) -> float:
    """Loudness, 0 to 1, of a mode's amplitude, m: proportional to its root, so that 10 mm down to 1 µm can be heard."""
    return math.sqrt(min(amplitude, LOUDEST) / LOUDEST) if amplitude > SILENT else 0.0


class Tones:
    """The tones of one beam."""

    def __init__(self, payload: Payload):
        self.payload = payload
        with one_blas_thread():
            beam = build_beam(payload)
        order = np.argsort(beam.modes.omega)
        omega = np.asarray(beam.modes.omega)[order]
        self.first = float(omega[0]) / (2 * np.pi)
        """Frequency of the first mode, Hz, at the payload's mass at the start."""
        self.factor = heard_factor(self.first)
        kept = order[: min(int(np.searchsorted(omega, 2 * np.pi * TOP / self.factor)), MOST_TONES)]
        self.omega = np.asarray(beam.modes.omega)[kept]
        shapes = beam.modes.V[:, kept]
        self._to_modes = product(beam.matrices.M_q, shapes)
        self._widest = np.array([peak_deflection(payload, shape) for shape in shapes.T])
        self.window = min(max(2 * np.pi / float(omega[0]), SHORTEST), LONGEST)
        """Length of the window, s."""

    def amplitudes(self, recent: Samples) -> np.ndarray:
        """Amplitude of each mode at its antinode, m, (modes,).

        It follows from the change of the modal velocity between samples, to which slow bending contributes little.
        """
        if len(recent) < 2 or recent.beam_rates.shape[1] != len(self._to_modes):
            return np.zeros(len(self.omega))
        rates = product(recent.beam_rates, self._to_modes)
        change = 2 * np.abs(np.sin(0.5 * self.omega * TICK))
        seen = change > 0.1  # Near a multiple of the sample rate, samples show no change.
        largest = np.where(
            seen, np.abs(np.diff(rates, axis=0)).max(axis=0) / np.where(seen, change, 1.0), np.abs(rates).max(axis=0)
        )
        return largest / self.omega * self._widest


class RingSound:
    """Sends the tones to the page. Call `update` for each picture while any browser has its sound on."""

    def __init__(self, gui: viser.GuiApi, look_back: LookBack):
        self._mark, self._look_back = gui.add_html(""), look_back
        self._tones: Tones | None = None
        self._count = 0

    def update(self, snapshot: Snapshot) -> None:
        """Update the tones; they are silent while the run is paused."""
        payload = snapshot.scenario.payload
        if self._tones is None or self._tones.payload != payload:
            self._tones = Tones(payload)
        tones, runs = self._tones, snapshot.playing and not snapshot.waiting
        found = tones.amplitudes(self._look_back.recent(tones.window)) if runs else np.zeros(len(tones.omega))
        factor = tones.factor * snapshot.first_frequency / tones.first  # Filling the payload lowers all modes alike.
        heard = [
            [round(factor * omega / (2 * math.pi), 2), round(loudness(amplitude), 4)]
            for omega, amplitude in zip(tones.omega.tolist(), found.tolist(), strict=True)
        ]
        self._count += 1
        told = json.dumps({"factor": tones.factor, "tones": heard}, separators=(",", ":")).replace('"', "&quot;")
        self._mark.content = f'<i hidden class="fl-tones" data-count="{self._count}" data-tones="{told}"></i>'
