"""What the lab chooses for the screen by itself."""

import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import viser
from lab_page import wait_until
from raw_browser import CAMERA, RawBrowser

from flexlab.control.motion import poses
from flexlab.control.path import build_motion
from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.number_control import Scale
from flexlab.lab.panel.run_comparison import change_text
from flexlab.lab.scene.cameras import FIELD_OF_VIEW, Window, first_view, floor_extent, overview, shot
from flexlab.lab.scene.overlays import path_points
from flexlab.lab.session import Session
from flexlab.lab.view_settings import fitting_window, tamed_exaggeration
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.sim.commands import Play, Reset
from flexlab.sim.runner import Runner
from flexlab.sim.world import World
from flexlab.text import escaped, number_text, speed_text
from flexlab.views import fitting_exaggeration


def test_the_exaggeration_suits_the_bending_of_the_beam() -> None:
    assert fitting_exaggeration(load_preset("paper")) == 50.0
    assert fitting_exaggeration(load_preset("soft-beam")) == 1.9
    still = Scenario().replace({"trajectory.amplitude": (0, 0, 0)})
    assert fitting_exaggeration(still) == 50.0


def test_a_softer_beam_is_never_drawn_straighter() -> None:
    """Whatever factor each run gets: its two digits may hide a tenth more compliance, but not half as much again."""
    drawn = []
    for stiffness in np.geomspace(1e4, 1.0, 24):
        scenario = load_preset("paper").replace({"payload.bending_stiffness": float(stiffness)})
        drawn.append(fitting_exaggeration(scenario) / stiffness)
    assert all(softer > stiffer for stiffer, softer in pairwise(drawn))


def test_a_large_deflection_lowers_the_exaggeration_and_a_small_one_keeps_it() -> None:
    assert tamed_exaggeration(50.0, 1.8e-3, 0.5) == 50.0
    assert tamed_exaggeration(50.0, 10e-3, 0.5) == 17.0
    assert tamed_exaggeration(17.0, 0.01e-3, 0.5) == 17.0, "a ring that dies out is seen to do so"
    assert tamed_exaggeration(17.0, 0.0, 0.5) == 17.0
    assert tamed_exaggeration(10.0, 0.4, 0.5) == 1.0, "never smaller than life"


def test_an_exaggeration_that_is_held_stays_with_other_presets_and_resets() -> None:
    runner = Runner(load_preset("paper"), "paper")
    lab_state = LabState(runner)
    lab_state.load(load_preset("soft-beam"), "soft-beam")
    assert lab_state.view.exaggeration == 1.9
    lab_state.hold_exaggeration(10.0)
    for preset in ("paper", "stiff-beam"):
        lab_state.load(load_preset(preset), preset)
        lab_state.submit(Reset())
        assert lab_state.view.exaggeration == 10.0
    lab_state.hold_exaggeration(None)
    lab_state.submit(Reset())
    assert lab_state.view.exaggeration == fitting_exaggeration(load_preset("stiff-beam"))


def test_a_large_deflection_lowers_a_held_exaggeration_until_a_new_run_begins() -> None:
    """Lesson 9 goes on until the beam buckles: its 81 mm were drawn 50 times as large, far outside the picture."""
    bent = load_preset("squeeze-until-it-buckles").replace(
        {"initial.beam_coordinates": (0.0, 0.0, 0.0, 0.08, 0.0, 0.0, 0.0, 0.0)}
    )
    runner = Runner(bent, "bent")
    lab_state = LabState(runner)
    lab_state.hold_exaggeration(50.0)
    lab_state.submit(Play())
    _run_on(runner)
    lab_state.fit_view(runner.snapshot)
    assert 0 < lab_state.view.exaggeration * 0.08 <= 0.36 * 0.5
    lab_state.load(load_preset("paper"), "paper")
    lab_state.fit_view(runner.snapshot)
    assert lab_state.view.exaggeration == 50.0, "the run on the screen is still the old one"
    _run_on(runner)
    lab_state.fit_view(runner.snapshot)
    assert lab_state.view.exaggeration == 50.0


def _run_on(runner: Runner) -> None:
    """Compute a few frames, until there are samples of the requested run."""
    for _ in range(5):
        time.sleep(0.01)
        runner.frame()


def test_the_plot_window_follows_the_speed() -> None:
    assert [fitting_window(speed) for speed in (4.0, 1.0, 1 / 16, 1 / 64, 1 / 256)] == [20.0, 5.0, 0.2, 0.1, 0.02]


@pytest.mark.parametrize("covered", [(0.0, 0.0), (0.35, 0.0), (0.0, 0.4)])
def test_the_payload_stands_in_the_free_part_of_the_picture(covered: tuple[float, float]) -> None:
    scenario, (above, below) = load_preset("paper"), covered
    position, look_at = shot("Payload", scenario, World(scenario).observe(), Window(1.2, above, below))
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    up = np.cross([1.0, 0.0, 0.0], forward)
    away = np.array([*scenario.trajectory.middle[:2], 0.0]) - position
    height = 0.5 + 0.5 * (away @ up) / (away @ forward) / np.tan(FIELD_OF_VIEW / 2)
    assert height == pytest.approx((below + 1 - above) / 2, abs=0.04)


def in_picture(position: np.ndarray, look_at: np.ndarray, x: float, y: float) -> tuple[float, float]:
    """Where a point of the floor is, to the right and upwards: -1 to 1 from edge to edge of a square picture."""
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = np.array([x, y, 0.0]) - position
    sideways, upwards = away @ right, away @ np.cross(right, forward)
    return tuple(np.array([sideways, upwards]) / (away @ forward) / np.tan(FIELD_OF_VIEW / 2))


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize("aspect", [0.46, 1.0, 2.2])
def test_both_ends_of_the_payload_stay_in_the_picture(name: str, aspect: float) -> None:
    """Also if the beam turns all the way round."""
    scenario = load_preset(name)
    path, length = scenario.trajectory, scenario.payload.length
    position, look_at = shot("Payload", scenario, World(scenario).observe(), Window(aspect))
    for x, y, theta in poses(build_motion(path), np.linspace(*path.window, 300))[:, 0]:
        for s in (-length / 2, length / 2):
            sideways, upwards = in_picture(position, look_at, x + s * np.cos(theta), y + s * np.sin(theta))
            assert abs(sideways) < aspect
            assert abs(upwards) < 1


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize(
    ("window", "shown"),
    [
        (Window(1.19, 0.05, 0.09, 900), ["bases", "wrists"]),  # 1440 x 900, plots and guide folded.
        (Window(1.43, 0.05, 0.08, 1080), ["bases", "wrists", "elbows"]),  # 1920 x 1080, plots and guide folded.
        (Window(0.91, 0.04, 0.07, 900), ["bases"]),  # 1440 x 900 beside the guide.
        (Window(1.78, 0.35, 0.0, 1080), ["bases"]),  # A presentation at 1920 x 1080, whose plot covers the upper part.
    ],
)
def test_the_first_view_shows_the_arms_where_the_payload_is_long_enough(
    name: str, window: Window, shown: list[str]
) -> None:
    if name == "spin-up" and window.above > 0.3:
        shown = []  # With its base in sight, the beam would be 246 px long.
    scenario = load_preset(name)
    position, look_at = first_view(scenario, window)
    path, length, arms = scenario.trajectory, scenario.payload.length, scenario.arms
    bases = [
        (x + aside, y + near) for x, y in (arm.base for arm in arms) for aside in (-0.1, 0.1) for near in (-0.1, 0.1)
    ]
    places: dict[str, list[tuple[float, float]]] = {"bases": bases, "wrists": [], "elbows": []}
    for x, y, theta in poses(build_motion(path), np.linspace(*path.window, 100))[:, 0]:
        for side, arm in zip((-1, 1), arms, strict=False):
            reach = side * (length / 2 + arm.link_length[2])
            base, wrist = complex(*arm.base), complex(x, y) + reach * np.exp(1j * theta)
            away = abs(wrist - base)
            bend = np.arccos((away**2 + 0.7**2 - 0.6**2) / (2 * away * 0.7))
            elbow = base + 0.7 * np.exp(1j * (np.angle(wrist - base) - arm.elbow * bend))
            places["wrists"].append((wrist.real, wrist.imag + 0.13))  # The joint has a radius, and stands high.
            places["elbows"].append((elbow.real, elbow.imag))
    seen = [in_picture(position, look_at, *place) for kind in shown for place in places[kind]]
    assert all(abs(sideways) < window.aspect for sideways, _ in seen)
    assert all(2 * window.below - 1 < upwards < 1 - 2 * window.above for _, upwards in seen)
    sight, middle = look_at - position, np.array([*path.middle[:2], 0.0])
    distance = (middle - position) @ sight / np.linalg.norm(sight)
    assert length / distance / (2 * np.tan(FIELD_OF_VIEW / 2)) * window.height >= 230


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize("aspect", [0.46, 1.0, 2.2])
def test_the_whole_floor_is_in_the_picture(name: str, aspect: float) -> None:
    scenario = load_preset(name)
    position, look_at = overview(scenario, Window(aspect))
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    for x, y in ((x, y) for x in (x_min, x_max) for y in (y_min, y_max)):
        sideways, upwards = in_picture(position, look_at, x, y)
        assert abs(sideways) < aspect
        assert abs(upwards) < 1


def test_slider_scales_convert_values_to_places_and_back() -> None:
    for path, whole in (("payload.bending_stiffness", False), ("gravity", False), ("payload.element_count", True)):
        scale = Scale(Scenario().about(path), whole)
        for value in (1.0, 7.0, 20.0):
            assert scale.value(scale.place(value)) == pytest.approx(value)
        assert np.isnan(scale.value(float("nan")))
        assert np.isnan(scale.value(float("inf")))
    log = Scale(Scenario().about("payload.bending_stiffness"), False)
    assert log.place(10) - log.place(1) == pytest.approx(log.place(100) - log.place(10))
    assert log.place(-3.0) == log.low
    assert log.place(1e9) == log.high


def test_the_marks_of_a_slider_are_in_order_with_their_labels_apart() -> None:
    """The style sheet of the page takes the first and the last mark for the ends."""
    scale = Scale(Scenario().about("controller.wanted_internal_force"))
    assert scale.marked([]) == scale.marks
    assert scale.marked([(50.1, "P_cr")]) == ((-100.0, "−100"), (50.1, "P_cr"), (100.0, "100"))
    assert scale.marked([(95.0, "P_cr")]) == ((-100.0, "−100"), (95.0, "P_cr"), (100.0, ""))


def test_texts_are_escaped_and_cut_and_numbers_are_written_for_people() -> None:
    assert escaped("<img src=x onerror=alert(1)>") == "&lt;img src=x onerror=alert(1)&gt;"
    assert len(escaped("a" * 1_000_000)) < 3000
    assert number_text(-0.5) == "−0.5"
    assert number_text(float("nan")) == "–"
    assert speed_text(1 / 256) == "1/256 ×"
    assert speed_text(2.0) == "2 ×"


def test_changes_are_written_with_a_sign_or_as_a_factor() -> None:
    assert change_text(150.2) == "+150 %"
    assert (change_text(1900.0), change_text(182_762.0)) == ("20 ×", "1800 ×"), "nobody reads six digits of per cent"
    assert change_text(-3.6) == "−4 %"
    assert change_text(-0.2) == change_text(0.4) == "0 %"
    assert change_text(float("nan")) == "–"


def test_a_path_in_millimetres_fills_neither_floor_nor_memory(session: Session) -> None:
    """Its run stops at once; the floor would have had 4 billion pixels of shading."""
    rows = ((0.0, 0.0, 750.0, 0.0), (1.0, 900.0, 750.0, 0.0), (2.0, 0.0, 900.0, 0.0))
    far = load_preset("paper").replace({"trajectory.kind": "table", "trajectory.rows": rows})
    for scenario in (far, far.replace({"left_arm.link_length": (20.0, 20.0, 20.0), "left_arm.base": (-20.0, -20.0)})):
        x_min, x_max, y_min, y_max = floor_extent(scenario)
        assert max(x_max - x_min, y_max - y_min) < 190
        run = session.runner.snapshot.run_number
        with RawBrowser(session):
            session.lab_state.load(scenario, "far")
            wait_until(
                lambda run=run: (now := session.runner.snapshot).run_number > run and now.status.failed,
                "it cannot be reached",
                60,
            )
            wait_until(
                lambda scenario=scenario: (
                    session._scene._reach._x.size <= 1e6
                    and session._scene._run_number == session.runner.snapshot.run_number
                ),
                "it is drawn",
                60,
            )
            assert "failed" not in session.lab_state.notice.text
    for name in preset_names():
        preset = load_preset(name)
        path, half, floor = preset.trajectory, 0.5 * preset.payload.length, floor_extent(preset)
        assert floor[0] <= path.middle[0] - path.reach[0] - half
        assert floor[3] >= path.middle[1] + path.reach[1] + half


def test_a_chosen_view_is_sent_even_if_the_browser_seems_to_show_it(session: Session) -> None:
    """A press came before the news of the turned camera: viser sent nothing, and the camera stayed as it was turned."""
    cameras, heard = session._cameras, list[tuple[float, ...]]()

    def is_moved_there() -> bool:
        heard.extend(browser.camera_positions())
        return bool(heard) and all(watch.put_at == pytest.approx(heard[-1]) for watch in cameras._watches.values())

    with RawBrowser(session) as browser:
        wait_until(is_moved_there, "the first view")
        (client,) = session.server.get_clients().values()
        for view in ("Payload", "Overview", "Overview"):
            heard.clear()
            cameras.choose(client, view)
            wait_until(is_moved_there, f"the view {view}", 20)


def test_news_of_the_camera_between_two_moves_drops_neither(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """viser sends no camera that it believes to be there: a view chosen once more stayed a hundredth beside its place."""
    cameras, look_at, heard = session._cameras, viser.CameraHandle.look_at, list[tuple[float, ...]]()

    def is_heard(place: Any) -> bool:
        heard.extend(browser.camera_positions())
        return bool(heard) and heard[-1] == pytest.approx(place)

    def look_and_hear(camera: viser.CameraHandle, there: Any) -> None:
        monkeypatch.undo()
        camera.look_at = there
        browser.send(CAMERA | {"position": place})
        wait_until(lambda: tuple(camera.position) == place, "the news of a browser that shows the view")

    with RawBrowser(session) as browser:
        (watch,) = wait_until(lambda: [each for each in cameras._watches.values() if each.put_at is not None], "a view")
        place = tuple(watch.put_at.tolist())
        wait_until(lambda: is_heard(place), "the first view")
        heard.clear()
        monkeypatch.setattr(viser.CameraHandle, "look_at", property(look_at.fget, look_and_hear))
        cameras.choose(watch.client, watch.view)
        wait_until(lambda: is_heard(place), "the first view once more", 20)


def test_a_reset_in_a_window_a_few_pixels_narrower_leaves_the_camera_where_it_was(session: Session) -> None:
    """Such a change does not move it; the next run did, by millimetres."""
    with RawBrowser(session) as browser:
        cameras: Any = session._cameras
        (watch,) = wait_until(lambda: [each for each in cameras._watches.values() if each.put_at is not None], "a view")
        place = tuple(watch.put_at.tolist())
        browser.send(CAMERA | {"position": place, "image_width": 1425})
        wait_until(lambda: watch.client.camera.aspect == pytest.approx(1425 / 900), "news of the window")
        session.lab_state.submit(Reset())
        wait_until(lambda: watch.run == session.runner.snapshot.run_number > 1, "another run")
        assert tuple(watch.put_at.tolist()) == place


def test_the_drawn_path_of_many_turns_is_round() -> None:
    """The chords of its eleven turns lay up to 6.8 mm beside one another, as a thick line with kinks."""
    points = path_points(load_preset("spin-up"))
    middles = 0.5 * (points[1:] + points[:-1]) - [-0.5, 0.75]
    np.testing.assert_allclose(np.hypot(*middles.T), 0.25, rtol=0, atol=5e-4)
