"""A recording opened in a real browser is drawn without a click, and the page contacts no other machine."""

import io
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
from browser_window import open_window
from PIL import Image
from playwright.sync_api import Browser
from recording_helpers import wait_until

from flexlab.recording.viewer import review
from flexlab.views import BLUE, GREEN, VERMILION


def shares(image: np.ndarray) -> list[float]:
    """Shares of an image's pixels in the colours of the two arms and of the beam, shaded or not."""
    return [float(np.mean(np.abs(image - color).max(axis=2) < 24)) for color in (BLUE, VERMILION, GREEN)]


def test_a_recording_shows_arms_and_plots_and_contacts_nobody_else(recording_file: Path, chromium: Browser) -> None:
    asked: list[str] = []
    # Whatever happens, the window closes before the server, which waits for open pages when it closes.
    with review(recording_file) as address, open_window(chromium, 640, 440, drawn=True) as window:
        page = window.new_page()
        page.on("request", lambda request: asked.append(urlsplit(request.url).hostname or ""))
        page.goto(address)

        def drawn() -> bool:
            page.wait_for_timeout(1000)
            image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), float)
            arms, plots = np.array_split(image, 2, axis=1)
            return min(shares(arms)) > 2e-4 and min(shares(plots)) > 2e-4

        wait_until(drawn, "arms, beam and curves are on the screen", patience=120)
    (source,) = parse_qs(urlsplit(address).query)["url"]
    assert set(asked) <= {"127.0.0.1", urlsplit(source).hostname, ""}
