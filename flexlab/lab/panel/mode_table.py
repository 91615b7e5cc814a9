"""The mode table, and ways to see one mode: slow motion, a run that starts in it, an animation of its shape."""

import math

import numpy as np

from flexlab.analysis.modes import Modes, PoleRow, sampling_text
from flexlab.analysis.stability import DiskMargin, Margin
from flexlab.errors import LabError
from flexlab.lab.mode_computation import ModeStudy, peak_deflection
from flexlab.lab.panel.playback import SPEEDS
from flexlab.lab.view_settings import EXAGGERATION, nice
from flexlab.lab.widgets import Widgets, put, table_html
from flexlab.sim.commands import Pause, Play, SetSpeed
from flexlab.sim.snapshot import Snapshot
from flexlab.text import counted, escaped, number_text

MOST_POLES = 6
"""Most rows of poles, the growing ones first."""
MOST_MODES = 8
"""Most rows of the table and choices of the menu: higher modes are too small to be seen."""
SEEN_AT = 2.0
"""Highest frequency on the screen in slow motion, Hz."""
SEEN_SIZE = 0.06
"""Size to which a mode is enlarged, in beam lengths."""
START_SIZE = 0.002
"""Amplitude of a run that starts in a mode, in beam lengths: far below the 5 % up to which the linear beam is valid."""
LOOKED_BACK = 0.5
"""Time over which the present vibration is measured, s."""
LEAST_VIBRATION = 1e-6
"""Vibration below which there is nothing to enlarge, m."""
STILL_COMPUTED = "The modes are still being computed: try again in a moment."


class ModePanel:
    """Mode table and buttons, made in the open GUI container."""

    def __init__(self, widgets: Widgets, study: ModeStudy):
        self._lab_state, self._study = widgets.lab_state, study
        self._paused_run = 0
        self._run_number = widgets.lab_state.snapshot.run_number
        study.ask(self._lab_state.intended)
        self._table = widgets.gui.add_html("")
        self._choice = widgets.gui.add_dropdown("Mode", tuple(str(k + 1) for k in range(MOST_MODES)), initial_value="1")
        seen = f"Sets the speed so that it moves below {SEEN_AT:g} Hz"
        bent = "A new run that starts with the beam bent in this mode"
        widgets.button("Slow motion for it", lambda _: self._slow_down(self._chosen()), hint=seen)
        widgets.button("Start in it", lambda _: self._start_in(self._chosen()), hint=bent)
        hint = "Draws the mode instead of the run"
        self._animate = widgets.checkbox("Animate its shape", False, lambda _: self._set_animation(), hint)
        self._problem = widgets.gui.add_html("")
        self._choice.on_update(widgets.handler(lambda _: self._set_animation()))

    def update(self, snapshot: Snapshot) -> None:
        """Update the table, and the switch: a run of another preset or file is drawn itself."""
        self._study.ask(snapshot.scenario)
        if snapshot.run_number != self._run_number:
            self._run_number = snapshot.run_number
            if self._lab_state.view.shown_mode is None:
                put(self._animate, value=False)
        result, problem = self._study.result, self._study.problem
        if result is not None and (shown := self._lab_state.view.shown_mode) is not None:
            problem = problem or _lacks(result, shown)  # The beam may have been changed since.
        waits = "" if problem else '<div class="fl">Computing …</div>'
        self._table.content = waits if result is None else modes_html(result)
        self._problem.content = f'<div class="fl fl-bad">{escaped(problem)}</div>' if problem else ""

    def _chosen(self) -> int:
        """Index of the chosen mode; raises `LabError` if this mesh has no such mode."""
        result, index = self._study.result, int(self._choice.value) - 1
        if result is None:
            raise LabError(self._study.problem or STILL_COMPUTED)
        if lacks := _lacks(result, index):
            raise LabError(lacks)
        return index

    def _set_animation(self) -> None:
        wanted = bool(self._animate.value)
        if wanted and self._lab_state.snapshot.playing:
            # The run is paused while the mode's shape moves.
            self._paused_run = self._lab_state.snapshot.run_number
            self._lab_state.submit(Pause())
        elif not wanted and self._paused_run == self._lab_state.snapshot.run_number:
            self._paused_run = 0
            self._lab_state.submit(Play())
        self._lab_state.set_view(shown_mode=None)
        if wanted:
            # After a change of the beam, the scene shows the mode as soon as it is computed.
            index = self._chosen() if self._study.result is not None else int(self._choice.value) - 1
            self._lab_state.set_view(shown_mode=index)

    def _slow_down(self, index: int) -> None:
        result = self._study.result
        assert result is not None
        self._slow_to(float(result.frequency[index]))
        vibration = np.abs(self._lab_state.runner.recent(LOOKED_BACK).vibration)
        size = float(vibration.max()) if len(vibration) else 0.0
        if size < LEAST_VIBRATION:
            self._lab_state.say(
                f"The beam hardly vibrates now: tap it, or start a run in mode {index + 1}, to see this mode."
            )
            return
        self._enlarge(size)

    def _start_in(self, index: int) -> None:
        scenario = self._lab_state.intended
        result = self._study.modes_of(scenario.payload)
        if result is None or index >= len(result.frequency):
            raise LabError(self._study.problem or STILL_COMPUTED)
        shape = result.shape[:, index]
        size = START_SIZE * scenario.payload.length
        start = tuple(float(value) for value in shape * size / peak_deflection(scenario.payload, shape))
        self._slow_to(float(result.frequency[index]))
        self._enlarge(size)
        self._lab_state.change({"initial.beam_coordinates": start, "initial.pose_rate": None})

    def _slow_to(self, frequency: float) -> None:
        speed = next((speed for speed in SPEEDS if speed * frequency <= SEEN_AT), SPEEDS[-1])
        self._lab_state.submit(SetSpeed(speed))

    def _enlarge(self, size: float) -> None:
        factor = nice(SEEN_SIZE * self._lab_state.intended.payload.length / size)
        self._lab_state.set_view(
            exaggeration=min(max(factor, 1.0), EXAGGERATION.high), follow_deflection=False, follow_speed=True
        )


def _lacks(result: Modes, index: int) -> str:
    """A sentence if the beam has no mode of this index, else empty."""
    if index < len(result.frequency):
        return ""
    has = counted(len(result.frequency), "mode")
    return f"Mode {index + 1} needs a finer mesh: this one has {has}. Give it more elements."


def modes_html(result: Modes) -> str:
    """The beam's modes, the closed loop's poles and its margins, as tables."""
    return f'<div class="fl">{_beam_html(result)}{_poles_html(result)}{_margin_html(result.disk_margin)}</div>'


def _beam_html(result: Modes) -> str:
    rows = []
    for k in range(min(len(result.frequency), MOST_MODES)):
        sideways, turning = 100 * result.lateral_participation[k], 100 * result.angular_participation[k]
        if max(sideways, turning) < 0.1:
            moved = "hardly"
        elif sideways > turning:
            moved = f"sideways, {sideways:.0f} %"
        else:
            moved = f"turning, {turning:.0f} %"
        ratio = number_text(100 * float(result.damping_ratio[k]), 2)
        rows.append((f"{k + 1}", f"{result.frequency[k]:.2f}", ratio, moved))
    table = table_html(rows, "mode", "f (Hz)", "ζ (%)", "excited by moving grips", numbers=(1, 2))
    return f'<h2 class="fl-title">{result.beam_title}</h2>{table}'


def _poles_html(result: Modes) -> str:
    note = f'<div class="fl-line">{escaped(result.note)}</div>' if result.note else ""
    if not len(result.poles):
        return f'<h2 class="fl-title">Arms, beam and controller together</h2>{note}'
    kind, sampling = "continuous", "controller continuous"
    if result.control_period is not None:
        kind, sampling = "sampled", sampling_text(result.control_period, result.input_delay)
    # Growing poles, then oscillating ones: poles of the pose alone decay without being seen.
    seen = [row for row in result.pole_rows() if row.verdict == "grows" or row.frequency > 0]
    table = table_html(map(_pole_cells, seen[:MOST_POLES]), "f (Hz)", "ζ (%)", "rate (1/s)", "of", numbers=(0, 1, 2))
    alarm = ""
    if result.unstable:
        rate = number_text(result.growth, 3)
        alarm = f'<div class="fl-box fl-error">Unstable: small motions grow at {rate} 1/s.</div>'
    return f'<h2 class="fl-title">Poles of the {kind} loop</h2><div class="fl-dim">{sampling}</div>{alarm}{table}{note}'


def _pole_cells(row: PoleRow) -> list[str]:
    frequency = f"{row.frequency:.2f}" if row.frequency else "–"
    cells = [frequency, number_text(100 * row.damping_ratio, 2), number_text(row.rate, 3), escaped(row.origin)]
    if row.verdict == "grows":
        cells[2] += " grows"
        return [f'<span class="fl-bad">{cell}</span>' for cell in cells]
    return cells


def _margin_html(margin: DiskMargin | None) -> str:
    if margin is None:
        return ""
    rows = [("all alike", _margin_text(margin.alike)), ("each independently", _margin_text(margin.each))]
    table = table_html(rows, "motors", "gain and phase together")
    return f'<h2 class="fl-title">How much the motors may deviate</h2>{table}'


def _margin_text(margin: Margin) -> str:
    low, high = margin.gain
    if margin.alpha == 0:
        return '<span class="fl-bad">none: unstable</span>'
    if not math.isfinite(high):
        return "any"
    return f"× {number_text(low, 2)} – {number_text(high, 2)}, ±{margin.phase:.0f}°"
