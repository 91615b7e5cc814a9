"""What is drawn is true: strain, reach, held points, the spectrum, the Lyapunov function and kept runs."""

import html
import json
import re

import numpy as np
import pytest
from lab_page import wait_until
from raw_browser import RawBrowser

from flexlab.analysis.lesson_measures import amplitude_spectrum
from flexlab.analysis.modes import modes
from flexlab.analysis.paper_equations import tracking_energy
from flexlab.errors import LabError
from flexlab.lab.panel.number_control import Scale
from flexlab.lab.panel.sections import three_valued
from flexlab.lab.plots import tabs
from flexlab.lab.plots.chart import DASHES
from flexlab.lab.plots.plots import POINTS, thinned, unbroken
from flexlab.lab.reference_run import ReferenceRun, common_metrics, whole_run
from flexlab.lab.scene.beam import PIECES, axial_loads, curvature_functions, strain_colors
from flexlab.lab.scene.forces import held_point
from flexlab.lab.scene.overlays import elbow_sines, shade
from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import differences
from flexlab.sim.commands import Pause, Pull
from flexlab.sim.geometry import arm_points, beam_points, deflection_at
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.signals import PLACES
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import TICK
from flexlab.views import SLIDING, views


@pytest.fixture(scope="module")
def paper() -> Samples:
    return simulate(load_preset("paper"), 0.5)


@pytest.mark.parametrize("boundary", ["pinned-pinned", "clamped-clamped", "clamped-pinned"])
def test_curvature_is_the_second_derivative_of_the_deflection(boundary: str) -> None:
    payload = Scenario().replace({"payload.element_count": 5, "payload.boundary": boundary}).payload
    q = np.random.default_rng(1).normal(size=(1, payload.coordinate_count)) * 1e-3
    middle = ((np.arange(PIECES) + 0.5) / PIECES - 0.5) * payload.length
    step = 1e-5
    w = [deflection_at(payload, q, middle + offset)[0] for offset in (-step, 0.0, step)]
    numeric = (w[0] - 2 * w[1] + w[2]) / step**2
    curvature = curvature_functions(payload, PIECES) @ q[0]
    np.testing.assert_allclose(curvature, numeric, rtol=1e-3, atol=1e-3 * np.abs(numeric).max())


def test_strain_colours_are_grey_at_zero_blue_below_and_red_above() -> None:
    low, middle, high, over = strain_colors(np.array([-1.0, 0.0, 1.0, 7.0])).astype(int)
    assert len(set(middle)) == 1
    assert low[2] > low[0]
    assert high[0] > high[2]
    np.testing.assert_array_equal(high, over)


def test_reach_is_shaded_where_an_arm_cannot_go() -> None:
    scenario = load_preset("paper")
    x, y = np.array([0.0, 0.0, 0.0]), np.array([0.75, 3.0, 1.18])
    sines = elbow_sines(scenario, x, y, 0.0)
    assert sines[0] > 0.5
    assert sines[1] == 0
    assert 0 < sines[2] < sines[0]
    picture = shade(sines)
    assert picture[0, 3] == 0
    assert picture[1, 3] > 0


def test_the_held_point_is_on_the_beam(paper: Samples) -> None:
    scenario, sample = load_preset("paper"), paper.slice(30, 31)
    along = beam_points(scenario, sample, 101, exaggeration=3.0)[0]
    for index in (0, 25, 50, 100):
        s = (index / 100 - 0.5) * scenario.payload.length
        held = held_point(scenario, sample, Pull(s, (0.0, 0.0), 1.0), 3.0)
        np.testing.assert_allclose(held, along[index], rtol=0, atol=1e-12)


def test_the_held_point_is_on_the_link(paper: Samples) -> None:
    scenario, sample = load_preset("paper"), paper.slice(30, 31)
    points = arm_points(scenario, sample)[0]
    for arm in (1, 2):
        for link in (1, 2, 3):
            ends = points[arm - 1, link - 1 : link + 1]
            length = scenario.arms[arm - 1].link_length[link - 1]
            for share in (0.0, 0.3, 1.0):
                held = held_point(scenario, sample, Pull(share * length, (0.0, 0.0), 1.0, (arm, link)))
                np.testing.assert_allclose(held, ends[0] + share * (ends[1] - ends[0]), rtol=0, atol=1e-12)


def test_the_spectrum_of_a_sine_has_its_amplitude_at_its_frequency() -> None:
    time = np.arange(4000) * 1e-3
    frequency, amplitude = amplitude_spectrum(0.3 * np.sin(2 * np.pi * 44.0 * time), 1e-3)
    assert frequency[np.argmax(amplitude)] == pytest.approx(44.0, abs=0.25)
    assert amplitude.max() == pytest.approx(0.3, rel=0.01)


def test_thinning_a_spectrum_keeps_its_lines() -> None:
    frequency = np.linspace(0, 500, 15_001)
    amplitude = np.full(15_001, 1e-3)
    amplitude[[1338, 5331]] = 1.0, 0.5
    grid, line = thinned(frequency, amplitude, 500.0)
    assert len(grid) == POINTS
    for place, height in ((frequency[1338], 1.0), (frequency[5331], 0.5)):
        assert line[np.argmin(np.abs(grid - place))] == height


def test_the_tracking_energy_is_the_kinetic_energy_of_a_rigid_motion(paper: Samples) -> None:
    scenario = load_preset("smooth-start").replace({"payload.bending_stiffness": 1e9, "payload.linear_density": 1e-3})
    run = simulate(scenario, 0.05)
    moved = Samples(**{**vars(run.slice(0, 40)), "sliding_variable": run.pose_rate[:40]})
    np.testing.assert_allclose(tracking_energy(scenario, moved), run.kinetic_energy[:40], rtol=1e-4)
    assert (tracking_energy(load_preset("paper"), paper) >= 0).all()


def test_the_tracking_energy_counts_the_mass_that_the_payload_has() -> None:
    begin = {"payload.mass_change": {"factor": 3.0, "begin": 0.0, "duration": 0.01}}
    plain = load_preset("paper")
    run = simulate(plain.replace(begin), 0.03).slice(20, 30)
    assert run.own["payload_mass"] == pytest.approx(3.0)
    heavy = tracking_energy(plain.replace({"payload.linear_density": 6.0}), Samples(**{**vars(run), "own": {}}))
    np.testing.assert_allclose(tracking_energy(plain.replace(begin), run), heavy, rtol=1e-9)


def test_plots_without_samples_have_no_values(paper: Samples) -> None:
    """As for a run that has not begun, or that stopped before its mesh was changed."""
    scenario, nothing = load_preset("paper"), paper.slice(0, 0)
    for plot in (plot for plots in tabs(scenario).values() for plot in plots):
        assert plot.values(scenario, nothing).shape == (len(plot.labels), 0), plot.title


def test_a_curve_has_one_colour_in_lab_and_recordings_and_its_own_dashes() -> None:
    scenario = load_preset("paper")
    colors = {
        (view.title, f"{curve} ({unit})"): color
        for view in views(scenario)
        for curve, unit, color in zip(view.curves, view.units, view.colors, strict=True)
    }
    for plot in (plot for plots in tabs(scenario).values() for plot in plots):
        title, _, arm = plot.title.partition(", ")
        for label, tone in zip(plot.labels, plot.tones, strict=True):
            known = colors.get((plot.title, label), colors.get((title, f"{arm.removesuffix(' arm')} {label}"), tone))
            assert tone == known, f"{plot.title}: {label}"
        assert len(set(plot.tones)) == len(plot.labels) <= len(DASHES), "each has its own colour and dashes"


def test_numbers_that_differ_for_x_y_and_theta_are_told_with_their_unit() -> None:
    assert three_valued(load_preset("large-swing")).startswith("Frequency f_d (Hz) is 0.5, 1, 0.5 for x, y, θ")
    assert three_valued(load_preset("paper")) == ""


def test_a_logarithmic_slider_that_would_begin_at_zero_is_linear() -> None:
    """A person's own law may declare one; when it did, nothing was drawn any more."""
    scale = Scale(Quantity("Weight", unit="1", low=0, high=1e9, logarithmic=True))
    assert [scale.low, scale.high, scale.place(1000.0), scale.value(5e8)] == [0, 1e9, 1000.0, 5e8]
    ratios = Scale(Quantity("Weight", unit="1", low=0, high=1e9, slider=(1.0, 1e6), logarithmic=True))
    assert [ratios.low, ratios.high, ratios.value(3.0)] == [0, 6, 1000.0]


def test_a_kept_run_is_read_by_time_and_compared_over_the_common_time(paper: Samples) -> None:
    scenario = load_preset("paper")
    kept = ReferenceRun("paper", scenario, paper.slice(100, 401))
    assert kept.span == pytest.approx((0.1, 0.4))
    found = kept.at(0.25)
    assert found is not None
    assert found.time[0] == pytest.approx(0.25)
    assert kept.at(0.05) is None
    assert kept.at(0.45) is None
    gap = ReferenceRun("paper", scenario, paper.take(np.r_[100:200, 300:401]))
    found = gap.at(0.35)
    assert found is not None
    assert found.time[0] == pytest.approx(0.35), "samples that were not recorded shift no others"
    assert gap.at(0.25) is None
    rows, (first, last) = common_metrics(kept, paper.slice(0, 301))
    assert (first, last) == pytest.approx((0.1, 0.3))
    np.testing.assert_array_equal(*zip(*((old.value, new.value) for old, new in rows), strict=True))
    assert {old.column.field: old.short for old, _ in rows}["settled"] == "not settled"
    assert common_metrics(kept, paper.slice(0, 50))[0] == []
    assert common_metrics(kept, paper.slice(0, 0))[0] == []


def test_a_kept_run_includes_what_the_engine_no_longer_remembers(paper: Samples) -> None:
    """The run is kept at 0.4 s; the engine remembers its last 0.1 s, and its recording lags a little."""
    newest = ReferenceRun("paper", load_preset("paper"), paper.slice(300, 401))

    def recorded(end: float, first: int = 0, last: int = 390) -> Samples:
        return paper.slice(first, min(last, int(np.searchsorted(paper.time, end))))

    whole = whole_run(newest, 0.0, recorded)
    assert whole.span == pytest.approx((0.0, 0.4))
    for name, values in paper.slice(0, 401).signals().items():
        np.testing.assert_array_equal(whole.samples.signals()[name], values)
    assert whole_run(newest, 0.3, recorded) is newest, "a run that went on from there has no earlier part"
    for missing in ({"first": 5}, {"last": 200}):
        with pytest.raises(LabError, match="was not recorded"):
            whole_run(newest, 0.0, lambda end, missing=missing: recorded(end, **missing))


def test_differences_name_every_changed_field() -> None:
    paper = load_preset("paper")
    other = paper.replace({"payload.bending_stiffness": 5.0, "controller.kind": "pd", "title": "other"})
    paths = {path for path, _, _ in differences(paper, other)}
    assert {"payload.bending_stiffness", "controller.kind", "controller.position_gain"} <= paths
    assert "title" not in paths
    assert differences(paper, paper) == []


def test_a_busy_engine_leaves_no_gap_in_the_plots() -> None:
    """The engine has gone on for half a second since the snapshot in which a tenth of a second was missing."""
    now = [0.0]
    runner = Runner(load_preset("paper"), clock=lambda: now[0])
    for _ in range(60):
        now[0] += 1 / 60
        runner.frame()
    newest = round(float(runner.snapshot.latest.time[0]) / TICK) - 600
    samples = unbroken(runner.recent, newest, missing=0.1, window=5.0)
    assert samples.time[0] <= (newest + 1) * TICK
    assert len(unbroken(runner.recent, newest, missing=0.1, window=0.2)) <= 201, "no more than the window shows"


def test_the_force_along_the_beam_is_drawn_as_it_is_recorded() -> None:
    run = simulate(load_preset("spin-up"), 2.0, 0.01)
    drawn = axial_loads(run.slice(200, 201), 1000)
    place = np.array(PLACES) * 1000 + 499.5
    np.testing.assert_allclose(np.interp(place, np.arange(1000), drawn), run.axial_load[200], rtol=1e-4)
    # Each place is pulled by the part of the beam beyond it; at the free end there is none.
    assert drawn[0] > drawn[500] > drawn[-1] > 0
    assert drawn[-1] < 0.01 * drawn[0]


def test_a_limit_moves_in_its_chart_which_is_not_drawn_anew(session: Session) -> None:
    """A new chart would lose its zoom, and flicker while the limit is dragged."""
    (chart,) = (chart for chart in session._plots._charts if chart._handle.title == SLIDING.title)
    with RawBrowser(session):
        for layer in (0.07, 0.09):
            session.lab_state.change({"controller.boundary_layer": layer})
            wait_until(lambda layer=layer: np.allclose(chart._handle.data[4], layer), "its upper line moves")
            np.testing.assert_allclose(chart._handle.data[5], -layer, rtol=1e-6)
        session.lab_state.submit(Pause())
        wait_until(lambda: not session.runner.snapshot.playing, "the run is paused")
        session.lab_state.change({"controller.boundary_layer": 0.05})
        wait_until(lambda: np.allclose(chart._handle.data[4], 0.05), "it also moves while time stands still")
        assert chart in session._plots._charts


def test_spectrum_and_sound_have_the_frequencies_of_the_present_mass_of_a_payload_that_is_filled() -> None:
    change = {"factor": 4.0, "begin": 0.1, "duration": 0.1}
    scenario = load_preset("paper").replace({f"payload.mass_change.{name}": value for name, value in change.items()})
    empty = modes(scenario).frequency[:3]
    with Session(scenario, "paper", shadows=False) as lab, RawBrowser(lab):

        def marks() -> np.ndarray:
            hertz, _, strokes = lab._plots._spectrum._handle.data
            return hertz[np.isfinite(strokes)][::2]

        np.testing.assert_allclose(marks(), empty, rtol=1e-6)
        wait_until(lambda: np.allclose(marks(), empty / 2, rtol=1e-6), "the marks follow the mass")
        lab._sound.update(lab.runner.snapshot)
        (told,) = re.findall('data-tones="(.*)"', lab._sound._mark.content)
        sound = json.loads(html.unescape(told))
        np.testing.assert_allclose([hertz for hertz, _ in sound["tones"]][:3], sound["factor"] * empty / 2, rtol=1e-4)
