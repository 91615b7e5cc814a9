"""A law in one file outside the package, as a person uses it: in the menu, with sliders, plots and recording."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from lab_page import wait_until
from lasting_window import LastingWindow

from flexlab.analysis.replay import replay
from flexlab.control.law import add_law_file, forget_law
from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import list_runs

FILE = Path(__file__).parents[1] / "control" / "own_laws" / "leaky_integral.py"
GAIN = "Velocity gain D (N·s/m)"


@pytest.fixture(scope="module")
def law() -> Iterator[str]:
    """The name of the file's law, known to flexlab."""
    yield add_law_file(FILE).kind
    forget_law("leaky-integral")


def test_a_law_from_a_file_works_in_menu_sliders_plots_recording_and_replay(
    law: str, window: LastingWindow, tmp_path: Path
):
    window.rest()
    recorder = Recorder(tmp_path)
    with Session(load_preset("paper"), "paper", port=window.port, shadows=False, consumers=[recorder]) as session:
        page = window.show(session)
        page.choose("Control law", law)
        wait_until(lambda: page.snapshot.scenario.controller.kind == law, "the law is taken up")
        page.wait_for_text("Largest integral I_max")
        section = page.box(GAIN).locator("xpath=ancestor::*[.//*[@role='slider']][1]")
        slider = section.get_by_role("slider").first
        slider.focus()
        slider.press("End")
        wait_until(lambda: page.snapshot.scenario.controller.velocity_gain == 5000.0, "the gain is at its slider's end")
        wait_until(lambda: page.box(GAIN).input_value() == "5000", "the box shows the slider's value")
        changed = float(page.snapshot.latest.time[0])
        wait_until(lambda: page.snapshot.latest.time[0] > changed + 0.5, "the arms go on under it")
        page.open_tab("Control")
        page.wait_for_text("W_u")
        assert not page.snapshot.status.failed
        assert not page.errors
    recorder.close(60)
    # A change to a law from a file begins a new recording, which continues from the last state.
    recording = read_recording(max(list_runs(tmp_path), key=lambda path: path.name))
    assert np.isfinite(recording.samples["asked_work"][-100:]).all()
    assert replay(recording).identical
