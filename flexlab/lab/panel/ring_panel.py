"""From a tap to frequency and damping, and from there to an input shaper or a gain, with one click each.

The newest free ring is fitted while the lab runs.
"""

import threading
from dataclasses import dataclass
from functools import partial

import viser

from flexlab.analysis.identification.estimates import RingFit
from flexlab.analysis.identification.free_ring import recent_ring
from flexlab.analysis.identification.remedies import SHAPERS, WANTED_RATIO, Remedies, remedies
from flexlab.analysis.identification.ring import fit_ring
from flexlab.errors import LabError, telling
from flexlab.lab.widgets import Widgets, put, table_html
from flexlab.sim.snapshot import Snapshot
from flexlab.text import escaped, number_text

LOOKED_BACK = 30.0
"""Time in which a ring is looked for, s; a runner keeps twice as much."""
SYMBOLS = {"lateral_vibration_gain": ("k_v", "1/(kg·s)"), "angular_vibration_gain": ("k_θ", "1/(kg·m²·s)")}


@dataclass(frozen=True)
class FittedRing:
    """The result of a fit."""

    fit: RingFit
    since: str
    """What started the ring, as in "the tap at t = 1.200 s"."""
    remedies: Remedies | None


class RingPanel:
    """Buttons and results, made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = widgets.lab_state
        self.is_busy = False
        """Whether a fit is running."""
        self.result: FittedRing | None = None
        """The newest result; None before the first fit, and if there was nothing to fit."""
        self._problem = ""
        hint = "Frequency and damping of the vibration since the last tap, release or stop"
        widgets.button("Fit the ring", lambda _: self.fit(), icon=viser.Icon.WAVE_SINE, hint=hint)
        self._found = widgets.gui.add_html("")
        hint = "Passes the path through this input shaper, designed for the fitted ring"
        self._shapers = [
            widgets.button(f"Use {name}", partial(self._use, name), visible=False, hint=hint) for name in SHAPERS
        ]
        hint = "Sets the vibration gain of the control law"
        self._damp = widgets.button("Use this gain", lambda _: self._use_gain(), visible=False, hint=hint)

    def fit(self) -> None:
        """Fit the newest ring, unless a fit is running."""
        if not self.is_busy:
            self.is_busy = True
            threading.Thread(target=self._work, name="flexlab-ring", daemon=True).start()

    def _work(self) -> None:
        runner = self._lab_state.runner
        with telling(self._give_up, "The ring could not be fitted ({})."):
            snapshot, samples = runner.snapshot, runner.recent(LOOKED_BACK)
            time, signal, since = recent_ring(samples, snapshot.events)
            fit = fit_ring(time, signal)
            self.result = FittedRing(fit, since, remedies(fit, snapshot.scenario))
        self.is_busy = False

    def _give_up(self, problem: str) -> None:
        self.result, self._problem = None, problem

    def update(self, _: Snapshot) -> None:
        """Show the result."""
        result, offered = self.result, self._offered()
        if self.is_busy:
            text = '<div class="fl fl-dim">Fitting …</div>'
        elif result is not None:
            text = ring_html(result, offered is not None and self._has(offered.gain_field))
        else:
            problem = self._problem
            text = f'<div class="fl"><div class="fl-box">{escaped(problem)}</div></div>' if problem else ""
        put(self._found, content=text)
        for button in self._shapers:
            put(button, visible=offered is not None)
        put(self._damp, visible=offered is not None and self._has(offered.gain_field))

    def _offered(self) -> Remedies | None:
        result = self.result
        return None if result is None or self.is_busy else result.remedies

    def _has(self, field: str) -> bool:
        return field in type(self._lab_state.intended.controller).model_fields

    def _use(self, shaper: str, _: object = None) -> None:
        offered = self._offered()
        if offered is None:
            raise LabError("Fit a ring first: the shaper is made for its frequency.")
        self._lab_state.change(offered.changes(shaper))

    def _use_gain(self) -> None:
        offered = self._offered()
        if offered is None or not self._has(offered.gain_field):
            raise LabError("This control law has no vibration gain: choose vibration-damping or composite.")
        self._lab_state.change({f"controller.{offered.gain_field}": float(f"{offered.gain:.4g}")})


def ring_html(found: FittedRing, has_gain: bool) -> str:
    """The fitted modes with their intervals, and the remedies."""
    fit = found.fit
    rows: list[tuple[str, str]] = []
    for k, mode in enumerate(fit.modes, start=1):
        rows.append((f"<b>f{k}</b>" if mode is fit.first else f"f{k}", escaped(str(mode.frequency))))
        rows.append((f"ζ{k}", escaped(str(mode.damping_ratio))))
    span = 1e3 * (fit.end - fit.start)
    head = f"Since {found.since}: {fit.samples} samples, {span:.0f} ms, noise {number_text(1e3 * fit.noise, 2)} mm"
    parts = [f'<div class="fl-dim">{escaped(head)}</div>{table_html(rows, numbers=(1,))}']
    if fit.change:
        parts.append(f'<div class="fl-line">{escaped(fit.change)}</div>')
    if found.remedies is not None:
        parts += [f'<div class="fl-line">{escaped(sentence)}</div>' for sentence in sentences(found.remedies, has_gain)]
    return f'<div class="fl">{"".join(parts)}</div>'


def sentences(offered: Remedies, has_gain: bool) -> list[str]:
    """The suggested shaper and gain, with reasons."""
    shapers = "; ".join(
        f"{one.name} ends {1e3 * one.delay:.1f} ms later and forgives ±{100 * one.band:.0f} %"
        for one in offered.shapers
    )
    symbol, unit = SYMBOLS[offered.gain_field]
    way = "This law takes it." if has_gain else "The laws vibration-damping and composite have it."
    return [
        f"Input shapers for {offered.frequency:.4g} Hz: {shapers}. Shortest that suffices: {offered.suggested}.",
        f"{symbol} = {number_text(offered.gain, 3)} {unit} damps this mode to ζ = {100 * WANTED_RATIO:.0f} %, if torques act at "
        f"once. {way}",
    ]
