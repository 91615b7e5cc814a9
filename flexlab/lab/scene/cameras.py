"""Floor, light and cameras with named views; each browser has its own camera.

A browser's camera is fitted to its window until the person moves it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import viser

from flexlab.lab.scene.arms import scene_size
from flexlab.lab.viser_internals import tell_camera
from flexlab.scenario import Scenario
from flexlab.sim.geometry import link_points
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Snapshot
from flexlab.text import limited
from flexlab.views import GRAY

CELL, SECTION = 0.1, 0.5
"""Grid spacing, m."""
SKY_INTENSITY = 0.9
"""Light from all sides, relative to three.js' unit: it lights the sides that the lamp above leaves dark."""
FLOOR_COLOR, FLOOR_OPACITY = (120, 130, 144), 0.16
"""The floor is a little darker than a light page and lighter than a dark one; beam and grips are brighter than both."""
LABEL_INSET = 0.03
"""Distance of the length labels from the floor's edge, m."""
LABEL_HEIGHT = 0.04
"""Height of the length labels above the floor, which would hide a part of them, m."""
ELBOW_SHARE = 0.88
"""How far an elbow swings out from its base, in lengths of the first link: the paper's motion with a little room."""
MARGIN = 0.25
"""Floor around the arms' reach, m."""
BEYOND = 3.0
"""How far the drawn floor extends further, m: to the edges of any picture."""
FIELD_OF_VIEW = np.radians(28.0)
"""Vertical field of view, rad: narrow, so that the plane of motion is hardly distorted."""
TILT = np.radians(24.0)
"""Angle between the line of sight and the vertical in the overview, rad."""
PLAN_TILT = np.radians(0.5)
"""The same angle in the plan view, rad: straight down would leave open which side is up."""
FRONT_TILT = np.radians(62.0)
CAPTION = 0.2
"""Room for the caption above the picture, m."""
FILLED = 0.97
"""Fraction of the window that the floor fills, in the direction that limits it."""
AROUND = 0.35
"""Room around the payload along its path, in payload lengths, for its bending and the arms that hold it; across the payload, it
is combined with the room for its turning by the root of the sum of squares."""
LEAST_FREE = 0.2
"""Least fraction of the picture's height that counts as free, whatever covers it."""
LEAST_LENGTH, NEARLY = 275, 0.9
"""Least length of the payload in the first view, px; on a small screen, this fraction of its length in the view of it alone."""
EXTENTS = 21
"""Number of extents that are tried from the whole floor to payload and bases, and from there to the payload."""
BASE_RADIUS = 0.13
"""Size of the paper's bases, m."""
CLOSE_UP = 2.6
"""Distance of the close views, in payload lengths."""
VIEWS = ("First view", "Payload", "Overview", "Plan", "Front", "Left grip", "Follow")
MOVING = ("Left grip", "Follow")
"""The views that move with the machine."""
Look = Callable[[viser.ClientHandle, str], None]
"""Shows a named camera view in one browser."""


def floor_extent(scenario: Scenario) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max of the floor, m, in whole cells: it holds the bases, the trajectory and the elbows' swing.

    A trajectory beyond the arms' reach, as one in mm, does not widen it further.
    """
    bases = np.array([arm.base for arm in scenario.arms])
    center, swing = np.array(scenario.trajectory.middle[:2]), np.array(scenario.trajectory.reach[:2])
    half = 0.5 * scenario.payload.length
    elbow = max(arm.link_length[0] for arm in scenario.arms)
    reached = max(sum(arm.link_length) for arm in scenario.arms) + 2 * half + MARGIN
    near, far = bases.min(axis=0), bases.max(axis=0)
    low = np.minimum(near - [ELBOW_SHARE * elbow, MARGIN], np.maximum(center - swing - half - MARGIN, near - reached))
    high = np.maximum(far + [ELBOW_SHARE * elbow, MARGIN], np.minimum(center + swing + half, far + reached))
    low, high = np.floor(low / CELL) * CELL, np.ceil(high / CELL) * CELL
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _sections(low: float, high: float) -> np.ndarray:
    """The multiples of `SECTION` from low to high, m."""
    return SECTION * np.arange(np.ceil(low / SECTION - 1e-6), np.floor(high / SECTION + 1e-6) + 1) + 0.0


def _lengths(axis: str, places: np.ndarray) -> list[tuple[float, str]]:
    """(place, text) along an axis; only the last text has name and unit, so that the others fit into a small window."""
    texts = [f"{place:g}".replace("-", "−") for place in places]
    return list(zip(places.tolist(), [*texts[:-1], *(f"{axis} = {text} m" for text in texts[-1:])], strict=True))


def draw_stage(scene: viser.SceneApi, scenario: Scenario, shadows: bool) -> None:
    """Draw the grid below the arms with lengths along its edges, and light from above and the side.

    The light is bright enough for both colour modes, without washing out the colours.
    """
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=True, cast_shadow=shadows)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(170, 178, 190), intensity=SKY_INTENSITY)
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    scene.add_grid(
        "/floor/grid",
        width=x_max - x_min + 2 * BEYOND,
        height=y_max - y_min + 2 * BEYOND,
        position=((x_min + x_max) / 2, (y_min + y_max) / 2, 0.0),
        cell_size=CELL,
        cell_color=GRAY,
        cell_thickness=0.3,
        section_size=SECTION,
        section_color=GRAY,
        section_thickness=0.7,
        plane_color=FLOOR_COLOR,
        plane_opacity=FLOOR_OPACITY,
        shadow_opacity=0.25,
    )
    for x, text in _lengths("x", _sections(x_min, x_max)):
        place = (x, y_min + LABEL_INSET, LABEL_HEIGHT)
        # The window's edge may cut the floor's corners: labels there stand further inside.
        side = "left" if x - x_min < CELL else "right" if x_max - x < CELL else "center"
        scene.add_label(f"/floor/x{x:g}", text, position=place, anchor=f"bottom-{side}", depth_test=True)
    for y, text in _lengths("y", _sections(y_min, y_max)):
        place = (x_min + LABEL_INSET, y, LABEL_HEIGHT)
        scene.add_label(f"/floor/y{y:g}", text, position=place, anchor="center-left", depth_test=True)


class Window(NamedTuple):
    """A browser's picture: width over height, the fractions of its height covered at the top and at the bottom, height in px."""

    aspect: float
    above: float = 0.0
    below: float = 0.0
    height: int = 900


class Shot(NamedTuple):
    """A camera position and the point that it looks at, m, (3,) each."""

    position: np.ndarray
    look_at: np.ndarray


def shot(view: str, scenario: Scenario, sample: Samples, window: Window) -> Shot:
    """The shot for one of `VIEWS`; the close views depend on `sample` (N = 1)."""
    if view == "Left grip":
        return _near(link_points(scenario, sample.pose)[0, 0], scenario, window, 0.5)
    if view == "Follow":
        return _near(sample.pose[0, :2], scenario, window, 1.0)
    if view == "Payload":
        return _fitted(_payload_room(scenario), window, TILT)
    if view == "First view":
        return first_view(scenario, window)
    return overview(scenario, window, {"Plan": PLAN_TILT, "Front": FRONT_TILT}.get(view, TILT))


def overview(scenario: Scenario, window: Window, tilt: float = TILT) -> Shot:
    """The view of the whole floor, `tilt` rad from the vertical."""
    return _fitted(_floor(scenario), window, tilt)


def first_view(scenario: Scenario, window: Window) -> Shot:
    """The overview, or as much of it as leaves the payload long enough: bases and payload come before the rest of the floor."""
    middle = np.array([*scenario.trajectory.middle[:2], 0.0])

    def length(seen: Shot) -> float:
        sight = seen.look_at - seen.position
        distance = float((middle - seen.position) @ sight / np.linalg.norm(sight))
        return scenario.payload.length / distance / (2 * np.tan(FIELD_OF_VIEW / 2)) * window.height

    floor, payload = (np.tile(corners, (2, 1)) for corners in (_floor(scenario), _payload_room(scenario)))
    with_bases = np.concatenate([payload[:4], _bases(scenario)])
    wide, near = (
        [_fitted(extent, window, TILT) for extent in np.linspace(first, last, EXTENTS)]
        for first, last in ((floor, with_bases), (with_bases, payload))
    )
    least = min(LEAST_LENGTH, NEARLY * length(near[-1]))
    long_enough = [seen for seen in wide if length(seen) >= LEAST_LENGTH]
    return next(iter(long_enough or [seen for seen in near if length(seen) >= least]), near[-1])


def _payload_room(scenario: Scenario) -> np.ndarray:
    """The corners of what the payload needs on its path, m, (4, 3)."""
    length, path = scenario.payload.length, scenario.trajectory
    tilted = 0.5 * np.sin(min(abs(path.middle[2]) + path.reach[2], np.pi / 2))
    half = np.array(path.reach[:2]) + [(0.5 + AROUND) * length, np.hypot(AROUND, tilted) * length]
    return _corners(np.array(path.middle[:2]) - half, np.array(path.middle[:2]) + half)


def _floor(scenario: Scenario) -> np.ndarray:
    """The corners of the floor and of the caption above it, m, (4, 3)."""
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    return _corners((x_min, y_min), (x_max, y_max + CAPTION))


def _bases(scenario: Scenario) -> np.ndarray:
    """The corners of the arms' bases, m, (4, 3)."""
    bases, radius = np.array([arm.base for arm in scenario.arms]), BASE_RADIUS * scene_size(scenario)
    return _corners(bases.min(axis=0) - radius, bases.max(axis=0) + radius)


def _corners(low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray) -> np.ndarray:
    """The corners of a rectangle on the floor between two points (2,) m, (4, 3)."""
    return np.array([(x, y, 0.0) for x in (low[0], high[0]) for y in (low[1], high[1])])


def _fitted(points: np.ndarray, window: Window, tilt: float) -> Shot:
    """The nearest shot in which the points (N, 3) m are in the free part of the picture, centred."""
    forward, up = np.array([0.0, np.sin(tilt), -np.cos(tilt)]), np.array([0.0, np.cos(tilt), np.sin(tilt)])
    across, along, ahead = points[:, 0], points @ up, points @ forward
    most = FILLED * np.tan(FIELD_OF_VIEW / 2)
    kept = min((1.0 - LEAST_FREE) / max(window.above + window.below, 1e-9), 1.0)
    side = most * max(window.aspect, 0.1)
    top, bottom = most * (1 - 2 * kept * window.above), -most * (1 - 2 * kept * window.below)
    # A camera at (x, u, f) sees a point (across, along, ahead) between slopes b and t: b (ahead − f) ≤ along − u ≤ t (ahead − f).
    places, fronts = [], []
    for place, low, high in ((across, -side, side), (along, bottom, top)):
        least, largest = float((place - high * ahead).max()), float((place - low * ahead).min())
        fronts.append((largest - least) / (high - low))
        places.append((least, largest, low, high))
    front = min(fronts)
    x, u = (0.5 * (least + largest + (low + high) * front) for least, largest, low, high in places)
    position = np.array([x, 0.0, 0.0]) + u * up + front * forward
    return Shot(position, position + position[2] / np.cos(tilt) * forward)


def _near(place: np.ndarray, scenario: Scenario, window: Window, size: float) -> Shot:
    distance = size * CLOSE_UP * scenario.payload.length / min(max(window.aspect, 0.1), 1.0)
    center, away = np.array([*place, 0.15]), np.array([0.0, -np.sin(TILT), np.cos(TILT)])
    return Shot(center + distance * away, center)


STANDING = ""
"""The view of a camera that no longer moves."""
LOWEST = 0.1
"""Least height of a camera above the floor, m."""
STILL = 1e-3
"""A camera within this distance of its last shot counts as not moved by the person, m."""
NO_WINDOW = Window(0.0)
SAME_ASPECT = 0.02
"""Changes of width over height below this do not move the camera."""

log = limited(__name__)


def _at_rest(one: np.ndarray, other: np.ndarray) -> bool:
    return float(np.linalg.norm(one - other)) < STILL


@dataclass
class _Watch:
    """One browser's camera."""

    client: viser.ClientHandle
    view: str = VIEWS[0]
    put_at: np.ndarray | None = None
    put_for: Window = NO_WINDOW
    covered: tuple[float, float, int] = NO_WINDOW[1:]
    """As in `Window`."""
    run: int = 0
    """Number of the run for which the camera was placed."""

    @property
    def is_reshaped(self) -> bool:
        """Whether the picture has another shape than the one for which the camera was placed."""
        return abs(self.client.camera.aspect - self.put_for.aspect) > SAME_ASPECT or self.covered != self.put_for[1:]


class ClientCameras:
    """The cameras of all browsers of one server; a browser that reconnects is a new one."""

    def __init__(self, server: viser.ViserServer, runner: Runner):
        self._server, self._runner = server, runner
        self._watches: dict[int, _Watch] = {}
        server.on_client_connect(self._greet)
        server.on_client_disconnect(self._forget)

    def choose(self, client: viser.ClientHandle, view: str) -> None:
        """Show one of `VIEWS` in one browser."""
        watch = self._watches.get(client.client_id)
        if watch is not None:
            watch.view = view
            self._aim(watch, self._runner.snapshot, anew=True)

    def cover(self, client: viser.ClientHandle, above: float, below: float, height: int) -> None:
        """Keep the machine in the free part of one browser's picture; `above`, `below`, `height`: as in `Window`."""
        watch = self._watches.setdefault(client.client_id, _Watch(client))
        watch.covered = (above, below, height)
        self._reshape(watch)

    def follow(self, snapshot: Snapshot) -> None:
        """Move the cameras that follow the machine and, with a new run, the fixed ones; called for every picture."""
        for watch in list(self._watches.values()):
            try:
                if watch.view in MOVING:
                    self._aim(watch, snapshot)
                elif watch.run != snapshot.run_number:
                    # Show where a new run's path goes, unless the person has moved the camera.
                    watch.run, put_at = snapshot.run_number, watch.put_at
                    moved = put_at is None or not _at_rest(watch.client.camera.position, put_at)
                    if watch.view != STANDING and not moved:
                        self._aim(watch, snapshot)
            except Exception:
                # A failure of one browser's camera must not stop the others.
                log.exception("the camera of browser %s cannot follow: it stays where it is", watch.client.client_id)
                watch.view = STANDING

    async def _greet(self, client: viser.ClientHandle) -> None:
        watch = self._watches.setdefault(client.client_id, _Watch(client))

        async def reshape(camera: viser.CameraHandle) -> None:
            if camera.position[2] < LOWEST:
                camera.position = np.array([*camera.position[:2], LOWEST])
                return
            self._reshape(watch)

        client.camera.on_update(reshape)

    def _reshape(self, watch: _Watch) -> None:
        """Fit the camera to a picture whose shape has changed, unless the person has moved it."""
        camera = watch.client.camera
        # viser restores its own first camera about two seconds after the page has opened.
        put_back = watch.view == VIEWS[0] and _at_rest(camera.position, self._server.initial_camera.position)
        stands = watch.put_at is None or _at_rest(camera.position, watch.put_at)
        if watch.view not in (*MOVING, STANDING) and (put_back or (stands and watch.is_reshaped)):
            self._aim(watch, self._runner.snapshot)

    async def _forget(self, client: viser.ClientHandle) -> None:
        self._watches.pop(client.client_id, None)

    def _aim(self, watch: _Watch, snapshot: Snapshot, anew: bool = False) -> None:
        """Show the watch's view; `anew`: even if the browser seems to show it, as news of a turned camera may be on its way."""
        camera = watch.client.camera
        if watch.is_reshaped:
            watch.put_for = Window(camera.aspect, *watch.covered)
        aim = shot(watch.view, snapshot.scenario, snapshot.display, watch.put_for)
        watch.put_at = aim.position
        with watch.client.atomic():
            # Position first: viser moves the point that is looked at along with it.
            camera.position, camera.look_at = aim.position, aim.look_at
            if anew:
                tell_camera(watch.client, aim.position, aim.look_at)
