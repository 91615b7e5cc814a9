"""Each browser's camera: fits its window until the person moves it, and goes to named views on request."""

import threading
from dataclasses import dataclass

import numpy as np
import viser

from flexlab.errors import LabError
from flexlab.lab.scene.camera_views import MOVING, VIEWS, Window, shot
from flexlab.log_limits import limited
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot

STANDING = ""
"""View of a camera that stays where it is, and is the person's own."""
LOWEST = 0.1
"""Height above the floor below which no camera goes, m: from below, the picture is a riddle."""
STILL = 1e-3
"""A camera this near to where it was put counts as not moved by the person, m."""
SAME_ASPECT = 0.02
"""Changes of width over height below this do not move the camera."""

log = limited(__name__)


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    return float(np.linalg.norm(one - other)) < STILL


@dataclass
class _Watch:
    """One browser."""

    client: viser.ClientHandle
    view: str = VIEWS[0]
    put_at: np.ndarray | None = None
    aspect: float = 0.0
    covered: tuple[float, float] = (0.0, 0.0)
    """Shares of the picture's height that something lies over, from above and from below."""
    put_for: tuple[float, float] = (0.0, 0.0)
    """Of them those that the camera was put for."""


class ClientCameras:
    """The cameras of all browsers of one server; a browser that comes back is a new one."""

    def __init__(self, server: viser.ViserServer, runner: Runner):
        self._server, self._runner = server, runner
        self._watches: dict[int, _Watch] = {}
        self._lock = threading.Lock()
        server.on_client_connect(self._greet)
        server.on_client_disconnect(self._forget)

    def choose(self, client: viser.ClientHandle, view: str) -> None:
        """Show one of `VIEWS` in one browser; raises `LabError` for another name."""
        if view not in VIEWS:
            raise LabError(f"{view[:40]!r} is not a camera view: choose one of {', '.join(VIEWS)}.")
        with self._lock:
            watch = self._watches.get(client.client_id)
        if watch is not None:
            watch.view = view
            self._aim(watch, self._runner.snapshot)

    def cover(self, client: viser.ClientHandle, above: float, below: float) -> None:
        """Keep the machine in the part of one browser's picture that nothing lies over; shares of its height."""
        with self._lock:
            watch = self._watches.setdefault(client.client_id, _Watch(client))
        watch.covered = (above, below)
        self._reshape(watch)

    def follow(self, snapshot: Snapshot) -> None:
        """Move the cameras that follow the payload; called for every picture."""
        with self._lock:
            watches = [watch for watch in self._watches.values() if watch.view in MOVING]
        for watch in watches:
            try:
                self._aim(watch, snapshot)
            except Exception:
                # One browser's camera is that browser's affair: everybody else's picture goes on.
                log.exception("the camera of browser %s cannot follow: it stays where it is", watch.client.client_id)
                watch.view = STANDING

    async def _greet(self, client: viser.ClientHandle) -> None:
        with self._lock:
            watch = self._watches.setdefault(client.client_id, _Watch(client))

        async def reshape(camera: viser.CameraHandle) -> None:
            if camera.position[2] < LOWEST:
                camera.position = np.array([*camera.position[:2], LOWEST])
                return
            self._reshape(watch)

        client.camera.on_update(reshape)

    def _reshape(self, watch: _Watch) -> None:
        """Fit a picture whose shape has changed, unless the person has moved the camera."""
        camera = watch.client.camera
        # viser puts its own first camera back some two seconds after the page has opened.
        put_back = watch.view == VIEWS[0] and _near(camera.position, self._server.initial_camera.position)
        stands = watch.put_at is None or _near(camera.position, watch.put_at)
        reshaped = abs(camera.aspect - watch.aspect) > SAME_ASPECT or watch.covered != watch.put_for
        if watch.view not in (*MOVING, STANDING) and (put_back or (stands and reshaped)):
            self._aim(watch, self._runner.snapshot)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._watches.pop(client.client_id, None)

    def _aim(self, watch: _Watch, snapshot: Snapshot) -> None:
        camera = watch.client.camera
        window = Window(camera.aspect, *watch.covered)
        aim = shot(watch.view, snapshot.scenario, snapshot.display, window)
        watch.put_at, watch.aspect, watch.put_for = aim.position, camera.aspect, watch.covered
        # Position first: viser moves the point looked at along with it.
        with watch.client.atomic():
            camera.position = aim.position
            camera.look_at = aim.look_at
