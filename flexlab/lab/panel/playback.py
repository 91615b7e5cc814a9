"""Playback: play and pause, single step, reset, speed, looking back, and the list of events.

Also the play screen: the beam, a tap, two sliders, the speed and a sentence; its *More* opens the lab with the same run. The
page decides which of the two it shows (`page.js`, `?play` in its address): both are in the same panel.
"""

import math
import time

import viser

from flexlab.errors import LabError
from flexlab.lab.look_back import LookBack
from flexlab.lab.panel.number_control import BOX_DIGITS
from flexlab.lab.panel.readouts import events_html
from flexlab.lab.panel.sections import Entry, Folder
from flexlab.lab.picking import Picking
from flexlab.lab.scene.cameras import VIEWS, Look
from flexlab.lab.widgets import Menu, Widgets, put
from flexlab.scenario import Scenario
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.commands import Pause, Play, Reset, SetSpeed, StepOnce
from flexlab.sim.snapshot import TICK, Snapshot
from flexlab.text import number_text, speed_text

SPEEDS = tuple(2.0**power for power in range(2, -9, -1))
"""Offered speeds in simulated seconds per wall second: 4 down to 1/256."""
SPEED_TEXTS = {speed_text(speed): speed for speed in SPEEDS}

STEPS_PER_SECOND = 10.0
"""Rate of steps while the step button is held."""
SAME_PRESS = 0.25
"""Time, wall s, within which a click after a key press or a hold of the same button belongs to it."""
KEY_REPEATS = 0.1
"""Time, wall s, within which a repeated key counts as held down."""
SHORTEST_PAST = 0.02
"""Shortest past that the bar spans, s. It stays at a new run: the picture is fitted above it, and would move."""
FINE_REACH, FINE, COARSE = 5.0, 0.001, 0.01
"""Reach of the bar, s, up to which its steps are the run's samples; these steps, and the coarser ones beyond, s."""
SENTENCE = (
    "Tap the beam or drag it: a stiffer one rings faster, a damped one comes to rest sooner, "
    "and slow motion shows how it bends."
)


def speed_menu(widgets: Widgets, label: str) -> Menu:
    """The menu of speeds, made in the open GUI container."""
    lab_state = widgets.lab_state
    return Menu(
        widgets,
        label,
        lambda: SPEED_TEXTS,
        lambda: speed_text(lab_state.target_speed),
        lambda word: lab_state.submit(SetSpeed(SPEED_TEXTS[word])),
        hint="Simulated time per real time",
    )


class Playback:
    """Play/pause, step, reset and speed, made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = widgets.lab_state
        self._key_at = self._held_at = -math.inf
        icon, hint = viser.Icon.PLAYER_PAUSE, "Pause or continue the simulation"
        self._play = widgets.button("Pause", lambda _: self._clicked(), icon=icon, color=None, hint=hint)
        # A press steps once and a hold goes on; the click that ends a hold is no step, but a click by the keyboard is.
        icon, hint = viser.Icon.PLAYER_TRACK_NEXT, "Advance by 1 ms; hold the button to continue"
        step = widgets.button("Step", lambda _: self._clicked_step(), icon=icon, hint=hint)
        step.on_hold(widgets.handler(lambda _: self._held_step()), callback_hz=STEPS_PER_SECOND)
        anew = "A new run from t = 0, same settings"
        widgets.button("Reset", lambda _: self.reset(), icon=viser.Icon.REFRESH, hint=anew)
        # The style sheet puts the button after this mark into the middle of the picture.
        self._begin_mark = widgets.gui.add_html('<i class="fl-begin"></i>', visible=False)
        icon = viser.Icon.PLAYER_PLAY
        self._begin = widgets.button(
            "Begin", lambda _: self._lab_state.submit(Play()), icon=icon, color=None, visible=False
        )
        self._speed = speed_menu(widgets, "Speed")

    def update(self, snapshot: Snapshot) -> None:
        """Label the play button with what it will do, and follow a speed that was set elsewhere."""
        self._play.label = "Pause" if snapshot.moves else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if snapshot.moves else viser.Icon.PLAYER_PLAY
        stands = not snapshot.moves and not snapshot.status.failed
        begins = stands and float(snapshot.latest.time[0]) == snapshot.start_time
        put(self._begin_mark, visible=begins)
        put(self._begin, visible=begins, label=f"Play from t = {number_text(snapshot.start_time, 5)} s")
        self._speed.settle()

    def pressed_key(self) -> None:
        """Play or pause by key, once while the key is held."""
        now, last = time.monotonic(), self._key_at
        self._key_at = now
        if now - last >= KEY_REPEATS:
            self._toggle()

    def _clicked(self) -> None:
        # In some browsers, a space on the focused button sends a key and then a click.
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
        """Start a new run with the same settings; it also plays if the last one played until it failed."""
        plays = self._lab_state.has_failed
        self._lab_state.submit(Reset())
        if plays:
            self._lab_state.submit(Play())

    def step(self) -> None:
        """Pause, and advance by one sample."""
        self._lab_state.submit(Pause())
        self._lab_state.submit(StepOnce())

    def faster(self, by: float) -> None:
        """Multiply the speed by a factor, within the range of the menu."""
        speed = self._lab_state.target_speed * by
        self._lab_state.submit(SetSpeed(min(max(speed, SPEEDS[-1]), SPEEDS[0])))


class Scrub:
    """The bar along the picture's lower edge that looks back in time, made in the open GUI container."""

    def __init__(self, widgets: Widgets, look_back: LookBack):
        self._look_back = look_back
        # The style sheet puts the bar after this mark below the picture; `accessibility.js` says its value as "3.2 s ago".
        self._words = widgets.gui.add_html("")
        self._bar = widgets.gui.add_slider(
            "Look back", -1.0, 0.0, FINE, 0.0, hint="Drag left to see the last minute of the run"
        )
        now, go_on, hint = viser.Icon.PLAYER_TRACK_NEXT, viser.Icon.PLAYER_PLAY, "Starts a new run from this state"
        self._back = widgets.button("Back to now", lambda _: look_back.back_to_now(), icon=now, visible=False)
        self._go_on = widgets.button(
            "Continue from here", lambda _: look_back.go_on(), icon=go_on, color=None, visible=False, hint=hint
        )
        self._bar.on_update(widgets.handler(lambda _: look_back.look(-float(self._bar.value))))
        self._ago = 0.0

    def update(self, _: Snapshot) -> None:
        """Follow the run: the bar goes back as far as one can look, and grows in steps."""
        ago, reach = self._look_back.ago, self._look_back.reach
        low = max(reach if ago else float(f"{reach:.2g}"), SHORTEST_PAST)
        put(self._bar, min=-low, step=FINE if low <= FINE_REACH else COARSE)
        if self._ago and not ago:
            self._bar.value = 0.0
        self._ago = ago
        for button in (self._back, self._go_on):
            put(button, visible=ago > 0)
        told = f'<span class="fl-box">Paused: {number_text(ago)} s ago</span>' if ago else ""
        put(self._words, content=f'<div class="fl fl-scrub">{told}</div>')


class Events:
    """Event list and "run to", made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = widgets.lab_state
        self._goal = widgets.gui.add_number(
            "Run to t (s)", 1.0, step=0.1, hint="As fast as this machine can, then pause"
        )
        self._goal.precision = BOX_DIGITS
        icon = viser.Icon.PLAYER_SKIP_FORWARD
        widgets.button("Run to it", lambda _: self.run_to(float(self._goal.value)), icon=icon)
        self._list = widgets.gui.add_html("")

    def update(self, snapshot: Snapshot) -> None:
        """Update the list."""
        self._list.content = events_html(snapshot)

    def run_to(self, goal: float) -> None:
        """Run to a simulation time, s; raises `LabError` for one that has passed or is too far."""
        now = float(self._lab_state.snapshot.latest.time[0])
        ticks = (goal - now) / TICK  # It may be infinite: the box takes every number.
        wanted = f"t = {number_text(goal, 6)} s"
        if ticks <= 0.5:
            raise LabError(f"{wanted} has passed (now {now:.3f} s): press Reset first, or choose a later time.")
        if ticks > MOST_STEPS + 0.5:
            raise LabError(f"{wanted} is more than {number_text(MOST_STEPS * TICK)} s ahead: go there in steps.")
        self._lab_state.submit(StepOnce(round(ticks)))


def _play_rows(scenario: Scenario) -> list[Entry]:
    """The beam's stiffness, and the parameter of its damping, whatever the kind."""
    (name,) = set(type(scenario.payload.damping).model_fields) - {"kind"}
    damping = f"payload.damping.{name}"
    return [
        Entry("payload.bending_stiffness", name="Stiffness EI", unit="N·m²"),
        Entry(damping, name="Beam's damping", unit=scenario.about(damping).unit),
    ]


class PlayScreen:
    """Controls of the play screen, made in the open GUI container."""

    def __init__(self, widgets: Widgets, touch: Picking, look: Look):
        with widgets.gui.add_folder("Play"):
            widgets.gui.add_html(f'<div class="fl fl-play">{SENTENCE}</div>')  # The page finds the play screen by it.
            icon, hint = viser.Icon.HAND_CLICK, "A transverse blow to the beam"
            widgets.button("Tap", lambda _: touch.tap(), icon=icon, color=None, hint=hint)
            widgets.gui.add_button("More", color="gray", hint="The whole lab, with this run")
            # The style sheet shows the button after this mark once somebody has turned the view.
            widgets.gui.add_html('<i class="fl-back"></i>')
            hint = "Moves the camera back to where it was, in this browser"
            widgets.button("Reset view", lambda event: look(event.client, VIEWS[0]), hint=hint)
            self._beam = Folder(widgets, None, _play_rows, is_open=True)
            self._speed = speed_menu(widgets, "Simulation speed")

    def update(self, _: Snapshot) -> None:
        """Follow the run, but leave alone a control that a person is using."""
        self._beam.settle()
        self._speed.settle()
