"""A recording opened in a real browser: drawn without a click, and without a word to anybody else."""

import io
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from browser_window import open_window
from PIL import Image
from playwright.sync_api import Browser, Page
from recording_helpers import wait_until

from flexlab.recording.recorded_plots import BLUE, GREEN, VERMILION
from flexlab.recording.viewer import open_review


def share_of(page: Page, color: tuple[int, int, int], left: float, right: float) -> float:
    """Share of the pixels between two fractions of the width that have a colour, shaded or not."""
    image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), float)
    part = image[:, int(left * image.shape[1]) : int(right * image.shape[1])]
    return float(np.mean(np.abs(part - color).max(axis=2) < 24))


def test_opening_a_recording_shows_arms_and_plots_and_calls_nobody(recording_file: Path, chromium: Browser) -> None:
    context = open_window(chromium, 1400, 900)
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(urlsplit(request.url).hostname or ""))
    with open_review(recording_file) as review:
        page.goto(review.url)

        def drawn() -> bool:
            page.wait_for_timeout(1000)
            arms = [share_of(page, color, 0, 0.5) for color in (BLUE, VERMILION, GREEN)]
            plots = [share_of(page, color, 0.5, 1) for color in (BLUE, VERMILION, GREEN)]
            return min(arms) > 2e-4 and min(plots) > 2e-4

        wait_until(drawn, "arms, beam and curves are on the screen", patience=120)
        context.close()
    assert set(asked) <= {"127.0.0.1", ""}
