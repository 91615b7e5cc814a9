"""Rerun's viewer in a browser shows live data, which come through the front server only."""

import io
from collections.abc import Callable
from urllib.parse import urlsplit

import numpy as np
from browser_window import open_window
from http_client import wait_until
from person import TOKEN
from PIL import Image
from playwright.sync_api import Browser

from flexlab.server.front_server import FrontServer
from flexlab.views import OLIVE, ROSE, VIOLET

NEAR, SHARE = 24, 2e-4
"""How near to its colour, of 255, a curve's pixels are, and the least share of such pixels once curves are drawn."""


def test_the_viewer_in_a_browser_shows_live_data(open_another: Callable[..., FrontServer], chromium: Browser):
    front_server = open_another(rerun=True, token=TOKEN)
    context = open_window(chromium, 640, 440)
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))

    def drawn() -> bool:
        page.wait_for_timeout(1000)
        image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), int)
        plots = image[:, image.shape[1] // 2 :]
        return all((abs(plots - color).max(axis=2) < NEAR).mean() > SHARE for color in (VIOLET, OLIVE, ROSE))

    try:
        page.goto(front_server.address("/live"))
        wait_until(drawn, "the viewer draws arms and plots", patience=120)
    finally:
        context.close()
    assert {urlsplit(url).port for url in asked if url.startswith("http")} == {front_server.port}
