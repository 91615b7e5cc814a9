"""Aims each browser's camera so that the machine fits its window, until the person moves the camera."""

from collections.abc import Callable

import numpy as np
import viser

from flexlab.lab.scene.camera import Shot

STILL = 1e-3
"""A camera this near to where it was put counts as not moved by the person, m."""
TELEPHONE_WIDTH = 576
"""Windows narrower than this, px, get viser's layout for telephones: a sheet over the lower half of the picture."""
SAME_ASPECT = 0.02
"""Changes of width over height below this do not move the camera."""


def keep_aimed(client: viser.ClientHandle, shot_for: Callable[[float, bool], Shot]) -> None:
    """Aim `client` by `shot_for(width over height, is a telephone)`, again whenever its window or panels change shape."""
    telephone = client.camera.image_width < TELEPHONE_WIDTH
    put_at: np.ndarray | None = None
    aspect_then = 0.0

    async def aim(camera: viser.CameraHandle) -> None:
        nonlocal put_at, aspect_then
        moved = put_at is not None and np.linalg.norm(camera.position - put_at) > STILL
        if moved or abs(camera.aspect - aspect_then) < SAME_ASPECT:
            return
        shot = shot_for(camera.aspect, telephone)
        # Position first: viser moves the point looked at along with it.
        with client.atomic():
            camera.position = shot.position
            camera.look_at = shot.look_at
        put_at, aspect_then = shot.position, camera.aspect

    client.camera.on_update(aim)
