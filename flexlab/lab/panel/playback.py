"""The clock: play and pause, single step, reset, speed, and the way back to what has happened in this run."""

import math
import time

import viser

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.look_back import LookBack
from flexlab.lab.panel.number_control import BOX_DIGITS, put
from flexlab.lab.panel.readouts import events_html
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.commands import Pause, Play, Reset, SetSpeed, StepOnce
from flexlab.sim.snapshot import TICK, Snapshot
from flexlab.text import number_text, speed_text

SPEEDS = tuple(2.0**power for power in range(2, -9, -1))
"""Choices of simulated seconds per wall second: 4 down to 1/256."""


STEPS_PER_SECOND = 10.0
"""While the step button is held."""
SAME_PRESS = 0.25
"""A click that follows the key, or the hold, of the same button within this time belongs to it, wall seconds."""
KEY_REPEATS = 0.1
"""The same of a key that follows itself: somebody holds it, wall seconds."""


class Playback:
    """Play/pause, step, reset and speed, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self._lab_state = lab_state
        self._key_at = self._held_at = -math.inf
        self._seen_speed = lab_state.snapshot.target_speed
        self._play = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE, hint="Hold or go on with simulation time")
        step = gui.add_button(
            "Step", icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", hint="1 ms further; hold the button to go on"
        )
        reset = gui.add_button(
            "Reset", icon=viser.Icon.REFRESH, color="gray", hint="A new run from t = 0, same settings"
        )
        # The style sheet puts the button that follows this mark into the middle of the picture.
        self._begin_mark = gui.add_html('<i class="fl-begin"></i>', visible=False)
        self._begin = gui.add_button("Begin", icon=viser.Icon.PLAYER_PLAY, visible=False)
        self._begin.on_click(handler(lab_state, lambda _: lab_state.submit(Play())))
        self._speeds = {speed_text(speed): speed for speed in SPEEDS}
        self._speed = gui.add_dropdown(
            "Speed", tuple(self._speeds), initial_value=speed_text(1.0), hint="Simulated time per real time"
        )
        self._play.on_click(handler(lab_state, lambda _: self._clicked()))
        # Pressing steps once and holding goes on; the click that ends it is no step, but that of the keyboard is one.
        step.on_hold(handler(lab_state, lambda _: self._held_step()), callback_hz=STEPS_PER_SECOND)
        step.on_click(handler(lab_state, lambda _: self._clicked_step()))
        reset.on_click(handler(lab_state, lambda _: self.reset()))
        self._speed.on_update(handler(lab_state, lambda _: self._set_speed(self._speed.value)))

    def update(self, snapshot: Snapshot) -> None:
        """Label the play button by what it will do, and follow a speed that was set elsewhere."""
        self._play.label = "Pause" if snapshot.playing else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if snapshot.playing else viser.Icon.PLAYER_PLAY
        stands = not snapshot.playing and not snapshot.status.failed
        begins = stands and float(snapshot.latest.time[0]) == snapshot.start_time
        put(self._begin_mark, visible=begins)
        put(self._begin, visible=begins, label=f"Play from t = {number_text(snapshot.start_time, 5)} s")
        shown = speed_text(snapshot.target_speed)
        if snapshot.target_speed != self._seen_speed and shown in self._speeds:
            self._seen_speed = snapshot.target_speed
            self._speed.value = shown

    def pressed_key(self) -> None:
        """Play or pause, by the key."""
        now, last = time.monotonic(), self._key_at
        self._key_at = now
        if now - last >= KEY_REPEATS:
            self._toggle()

    def _clicked(self) -> None:
        # A space on the focused button is a key and then a click in some browsers.
        if time.monotonic() - self._key_at >= SAME_PRESS:
            self._toggle()

    def _toggle(self) -> None:
        self._lab_state.submit(Pause() if self._lab_state.playing else Play())

    def _held_step(self) -> None:
        self._held_at = time.monotonic()
        self.step()

    def _clicked_step(self) -> None:
        if time.monotonic() - self._held_at >= SAME_PRESS:
            self.step()

    def reset(self) -> None:
        """A new run with the same settings."""
        self._lab_state.submit(Reset())

    def step(self) -> None:
        """Hold, and go one sample further."""
        self._lab_state.submit(Pause())
        self._lab_state.submit(StepOnce())

    def faster(self, by: float) -> None:
        """Multiply the speed, as far as the menu goes."""
        speed = self._lab_state.target_speed * by
        self._lab_state.submit(SetSpeed(min(max(speed, SPEEDS[-1]), SPEEDS[0])))

    def _set_speed(self, choice: str) -> None:
        if choice not in self._speeds:
            raise LabError(f"{choice[:40]!r} is not a speed of the menu: choose one from 1/256 × to 4 ×.")
        self._lab_state.submit(SetSpeed(self._speeds[choice]))


SHORTEST_PAST = 0.02
"""s that there are to look back at before the bar is shown."""
FINE_REACH, FINE, COARSE = 5.0, 0.001, 0.01
"""s: up to this reach the bar's steps are the run's samples, beyond it they are coarser."""


class Scrub:
    """The bar along the lower edge of the picture that goes back in time, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, look_back: LookBack):
        self._look_back = look_back
        # The style sheet puts what follows this mark below the picture; `accessibility.js` says its value as "3.2 s ago".
        self._words = gui.add_html("")
        self._bar = gui.add_slider(
            "Look back", -1.0, 0.0, FINE, 0.0, visible=False, hint="Drag it to the left: the last minute of the run"
        )
        self._back = gui.add_button("Back to now", icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", visible=False)
        self._go_on = gui.add_button(
            "Continue from here",
            icon=viser.Icon.PLAYER_PLAY,
            visible=False,
            hint="A new run that begins with this state",
        )
        self._bar.on_update(handler(lab_state, lambda _: look_back.look(-float(self._bar.value))))
        self._back.on_click(handler(lab_state, lambda _: look_back.back_to_now()))
        self._go_on.on_click(handler(lab_state, lambda _: look_back.go_on()))
        self._ago = 0.0

    def update(self) -> None:
        """Follow the run: the bar goes back as far as one can look, in steps while that grows."""
        ago, reach = self._look_back.ago, self._look_back.reach
        low = max(reach if ago else float(f"{reach:.2g}"), SHORTEST_PAST)
        put(self._bar, min=-low, step=FINE if low <= FINE_REACH else COARSE, visible=reach >= SHORTEST_PAST)
        if self._ago and not ago:
            self._bar.value = 0.0
        self._ago = ago
        for button in (self._back, self._go_on):
            put(button, visible=ago > 0)
        told = f'<span class="fl-box">Paused: {number_text(ago)} s ago</span>' if ago else ""
        put(self._words, content=f'<div class="fl fl-scrub">{told}</div>')


class Events:
    """Event list and "run to", in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self._lab_state = lab_state
        self._goal = gui.add_number("Run to t (s)", 1.0, step=0.1, hint="As fast as this machine can, then hold")
        self._goal.precision = BOX_DIGITS
        run = gui.add_button("Run to it", icon=viser.Icon.PLAYER_SKIP_FORWARD, color="gray")
        run.on_click(handler(lab_state, lambda _: self.run_to(float(self._goal.value))))
        self._list = gui.add_html("")

    def update(self, snapshot: Snapshot) -> None:
        """Bring the list up to date."""
        self._list.content = events_html(snapshot)

    def run_to(self, goal: float) -> None:
        """Run to a simulation time, s; raises `LabError` for one that has passed or is too far away."""
        now = float(self._lab_state.snapshot.latest.time[0])
        ticks = (goal - now) / TICK  # May be infinite: the box takes every number.
        if ticks <= 0.5:
            raise LabError(f"t = {goal:g} s has passed (now {now:.3f} s): press Reset first, or choose a later time.")
        if ticks > MOST_STEPS + 0.5:
            raise LabError(f"t = {goal:g} s is more than {MOST_STEPS * TICK:g} s ahead: go there in steps.")
        self._lab_state.submit(StepOnce(round(ticks)))
