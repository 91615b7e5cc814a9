"""The paper's figures as files: they show the run's signals, and the same run gives the same file."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from flexlab.analysis.figures import FIGURES, draw_figure, draw_signals, paper_figures, thin_out
from flexlab.errors import RecordingError, StudyError
from flexlab.presets import load_preset
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.views import BLUE, GREEN, VIOLET


def test_all_figures_are_drawn_in_both_formats(run: Run, tmp_path: Path) -> None:
    paths = paper_figures(run, tmp_path / "figures", name="paper")
    assert [path.name for path in paths] == [
        f"paper-figure-{n}.{kind}" for n in (2, 3, 4, 5) for kind in ("png", "svg")
    ]
    for path in paths:
        if path.suffix == ".png":
            image = np.asarray(Image.open(path).convert("RGB"))
            assert image.shape[1] == 1200
            tone = {2: GREEN, 3: GREEN, 4: VIOLET, 5: BLUE}[int(path.stem[-1])]  # As in the lab's plots and scene.
            assert (np.abs(image.astype(int) - tone).max(axis=2) < 8).mean() > 5e-4
        else:
            text = path.read_text()
            assert text.startswith("<?xml")
            assert "t (s)" in text


def test_curves_are_the_runs_signals(run: Run) -> None:
    (desired, actual) = draw_figure(2, run).axes[1].get_lines()
    np.testing.assert_array_equal(actual.get_ydata(), run.pose[:, 1])
    np.testing.assert_array_equal(desired.get_ydata(), run.desired_pose[:, 1])
    bent, held = draw_figure(3, run).axes[0].get_lines()
    np.testing.assert_array_equal(bent.get_ydata(), 1e3 * run.midspan_deflection)
    np.testing.assert_array_equal(held.get_ydata(), 1e3 * run.quasi_static_deflection)
    np.testing.assert_array_equal(
        draw_figure(4, run).axes[2].get_lines()[0].get_ydata(), 1e3 * run.tracking_error[:, 2]
    )
    left, right = draw_figure(5, run).axes[0].get_lines()
    np.testing.assert_array_equal(left.get_ydata(), run.internal_force[:, 0, 0])
    np.testing.assert_array_equal(right.get_ydata(), run.internal_force[:, 1, 0])
    assert [axes.get_ylabel() for axes in draw_figure(5, run).axes] == ["F x (N)", "F y (N)", "F θ (N·m)"]


def test_the_same_run_gives_the_same_file(run: Run, tmp_path: Path) -> None:
    one = paper_figures(run, tmp_path / "one", formats=["svg"])
    other = paper_figures(run, tmp_path / "other", formats=["svg"])
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in other]


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_values_that_no_axis_can_show_become_gaps(run: Run, tmp_path: Path) -> None:
    beyond = {name: np.where(np.arange(len(run)) % 2, 1e308, 1.0) for name in ("midspan_deflection", "vibration")}
    paper_figures(run.having(**beyond), tmp_path, formats=["svg"])
    shown = draw_figure(3, run.having(**beyond)).axes[0].get_lines()[0].get_ydata()
    assert np.nanmax(np.asarray(shown)) == 1e3
    draw_signals(Run(**run.having(**beyond).signals(), scenario=run.scenario, status=run.status))


def test_one_arm_has_figures_too(tmp_path: Path) -> None:
    run = simulate(load_preset("single-arm"), duration=0.1)
    assert len(paper_figures(run, tmp_path, formats=["svg"])) == len(FIGURES)
    assert len(draw_figure(5, run).axes[0].get_lines()) == 1


def test_the_time_axis_of_a_figure_is_that_of_the_run(run: Run) -> None:
    figure = draw_figure(4, run.slice(200, 401))
    assert figure.axes[0].get_xlim() == (0.2, 0.4)


def test_thinning_keeps_every_peak() -> None:
    time = np.arange(100_000) * 0.001
    ring = np.sin(2 * np.pi * 44.6 * time)
    ring[54_321] = 7.0
    short_time, short = thin_out(time, ring)
    assert len(short) <= 4002
    assert short.max() == 7.0
    assert (short_time[0], short_time[-1]) == (time[0], time[-1])
    assert np.all(np.diff(short_time) > 0)
    # An envelope, not an alias: every stretch of 50 ms, two points, still reaches nearly to 1 on both sides.
    rows = np.rint(1e3 * short_time)
    for start in range(0, 100_000, 50):
        part = short[(rows >= start) & (rows < start + 50)]
        assert part.max() > 0.99
        assert part.min() < -0.99


def test_what_cannot_be_drawn_is_refused_with_a_reason(run: Run, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="format = gif is not a format of figures: choose png or svg"):
        paper_figures(run, tmp_path, formats=["gif"])
    with pytest.raises(RecordingError, match="The run has no samples"):
        paper_figures(run.take(run.time < 0), tmp_path)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StudyError, match="cannot be written"):
        paper_figures(run, tmp_path / "file" / "x")
