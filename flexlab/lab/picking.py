"""Dragging the beam or a link pulls it with a spring; clicking the beam taps it with a calibrated impulse.

Both are commands, so the log and a replay contain them.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import viser

from flexlab.errors import LabError
from flexlab.lab.panel.number_control import NumberControl
from flexlab.lab.scene.arms import BEAM_HEIGHT, LINK_HEIGHTS, scene_size
from flexlab.lab.widgets import Widgets
from flexlab.quantities import Quantity
from flexlab.sim.commands import Pull, Tap
from flexlab.sim.geometry import arm_points

STIFFNESS = Quantity("Pull stiffness", unit="N/m", low=1, high=1e5, slider=(10, 10000), logarithmic=True)
IMPULSE = Quantity("Tap impulse", unit="N·s", low=1e-4, high=100, slider=(1e-3, 1), logarithmic=True)
PLACE = Quantity("Tap place s/L", low=-0.5, high=0.5, slider=(-0.5, 0.5))
STEEPEST = 0.05
"""Least vertical component of a line of sight (unit vector) that is intersected with the plane of motion."""
LONGEST_SILENCE, LOOK = 5.0, 0.5
"""Time without a message of the browser that pulls after which the pull ends, and time between two checks, s. The page sends one
a second while a mouse button is down; a line that was cut may take minutes to be noticed."""


class Held(NamedTuple):
    """The point that is pulled: `position` and `link` as in `Pull`, `height` above the floor, m; `client`: who pulls."""

    position: float
    link: tuple[int, int] | None
    height: float
    client: int


class Picking:
    """Turns drags and clicks on the drawn machine into commands. `stiffness` N/m, `impulse` N·s, `place` s/L.

    There is one hand: who begins to drag takes over. It lets go when the browser that drags has left, or is silent.
    """

    def __init__(self, widgets: Widgets, silence: Callable[[int], float]):
        """`silence(client)`: time since the newest message of a browser, s; infinite once it has left."""
        self._lab_state, self._handler, self._silence = widgets.lab_state, widgets.handler, silence
        self._held: Held | None = None
        self.stiffness, self.impulse, self.place = 500.0, 0.15, 0.0

    def attach(self, beam: viser.MeshHandle, links: viser.BatchedMeshHandle) -> None:
        """Make the drawn beam and arms react to dragging and clicking; links are instances, arm by arm, from the base."""
        beam.on_drag("left")(self._handler(lambda event: self._drag(event, self._take_beam)))
        beam.on_click(self._handler(lambda event: self._tap_at(self._on_beam(self._seen(event)))))
        links.on_drag("left")(self._handler(lambda event: self._drag(event, self._take_link)))

    def tap(self) -> None:
        """Tap at the chosen place."""
        self._tap_at(self.place * self._lab_state.snapshot.scenario.payload.length)

    def _tap_at(self, s: float) -> None:
        """Give the beam a transverse impulse at `s` m, towards its positive side."""
        angle = float(self._lab_state.snapshot.display.pose[0, 2])
        self._lab_state.submit(Tap(s, (-self.impulse * float(np.sin(angle)), self.impulse * float(np.cos(angle)))))

    def _drag(self, event: Any, take: Callable[[Any], Held]) -> None:
        held = self._held
        if held is not None and held.client != event.client.client_id and event.phase != "start":
            return
        if event.phase == "end":
            self._let_go()
            return
        if held is None or event.phase == "start":
            held = self._held = take(event)
            self._watch(held)
        # Follow the line of sight: viser moves the pointer in a plane that faces the camera, not in the machine's plane.
        eye = np.array(event.client.camera.position)
        target = _meet(eye, np.array(event.end_position) - eye, held.height)
        self._lab_state.pull(Pull(held.position, (float(target[0]), float(target[1])), self.stiffness, held.link))

    def _let_go(self) -> None:
        self._held = None
        self._lab_state.pull(None)

    def _watch(self, held: Held) -> None:
        """Let go once the browser that pulls is gone."""
        if held is not self._held:
            return
        if self._silence(held.client) > LONGEST_SILENCE:
            self._let_go()
        else:
            asyncio.get_running_loop().call_later(LOOK, self._watch, held)

    def _take_beam(self, event: Any) -> Held:
        place = self._on_beam(np.array(event.start_position[:2]))
        return Held(place, None, self._height(BEAM_HEIGHT), event.client.client_id)

    def _take_link(self, event: Any) -> Held:
        snapshot = self._lab_state.snapshot
        arm, link = divmod(event.instance_index, len(LINK_HEIGHTS))
        inner, outer = arm_points(snapshot.scenario, snapshot.display)[0, arm, link : link + 2]
        length = snapshot.scenario.arms[arm].link_length[link]
        along = float((np.array(event.start_position[:2]) - inner) @ (outer - inner)) / length
        height = self._height(LINK_HEIGHTS[link])
        return Held(min(max(along, 0.0), length), (arm + 1, link + 1), height, event.client.client_id)

    def _on_beam(self, place: np.ndarray) -> float:
        """The material coordinate s, m, of the beam's point nearest to a point (x, y), m, of the plane."""
        snapshot = self._lab_state.snapshot
        x, y, angle = snapshot.display.pose[0]
        half = 0.5 * snapshot.scenario.payload.length
        along = (place[0] - x) * np.cos(angle) + (place[1] - y) * np.sin(angle)
        return float(np.clip(along, -half, half))

    def _seen(self, event: Any) -> np.ndarray:
        return _meet(np.array(event.ray_origin), np.array(event.ray_direction), self._height(BEAM_HEIGHT))

    def _height(self, drawn: float) -> float:
        return drawn * scene_size(self._lab_state.snapshot.scenario)


def _meet(origin: np.ndarray, direction: np.ndarray, height: float) -> np.ndarray:
    direction = direction / max(float(np.linalg.norm(direction)), 1e-12)
    if abs(direction[2]) < STEEPEST:
        raise LabError("The camera looks along the plane of motion: choose the overview to touch the machine.")
    return (origin + direction * (height - origin[2]) / direction[2])[:2]


def touch_controls(widgets: Widgets, touch: Picking) -> list[NumberControl]:
    """Add the controls of pulls and taps to the open GUI container; returns those of numbers."""
    words = "Drag the beam or a link to pull it with a spring; click the beam to tap it. Drag empty space to turn the camera."
    widgets.gui.add_html(f'<div class="fl fl-dim">{words}</div>')
    shown = (STIFFNESS, "stiffness"), (IMPULSE, "impulse"), (PLACE, "place")
    controls = [_control(widgets, about, touch, name) for about, name in shown]
    icon, hint = viser.Icon.HAND_CLICK, "A transverse impulse on the beam"
    widgets.button("Tap", lambda _: touch.tap(), icon=icon, hint=hint)
    return controls


def _control(widgets: Widgets, about: Quantity, touch: Picking, name: str) -> NumberControl:
    usual = getattr(touch, name)
    read, ask, hint = partial(getattr, touch, name), partial(setattr, touch, name), f"Allowed: {about.range_text()}."
    return NumberControl(widgets, about, read, ask, lambda: usual, hint=hint)
