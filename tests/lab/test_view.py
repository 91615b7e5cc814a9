"""What the lab chooses for the screen by itself."""

import numpy as np
import pytest

from flexlab.lab.panel.number_control import Scale
from flexlab.lab.panel.run_comparison import change_text
from flexlab.lab.panel.text import escaped, factor, number
from flexlab.lab.scene.camera_views import FIELD_OF_VIEW, Window, overview
from flexlab.lab.scene.stage import floor_extent
from flexlab.lab.view_settings import FollowedExaggeration, fitting_exaggeration, fitting_window
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario


def test_exaggeration_suits_the_beam() -> None:
    assert fitting_exaggeration(load_preset("paper")) == 50.0
    assert fitting_exaggeration(load_preset("soft-beam")) == 1.0
    still = Scenario().replace({"trajectory.amplitude": (0, 0, 0)})
    assert fitting_exaggeration(still) == 50.0


def test_exaggeration_follows_the_deflection() -> None:
    """Five per cent of the length is aimed at: less at once when it is too wild, more only when it stays too small."""
    followed = FollowedExaggeration(patience=3)
    assert followed.fit(50.0, 0.4e-3, 0.5) == 50.0
    assert followed.fit(50.0, 1.8e-3, 0.5) == 10.0
    assert [followed.fit(10.0, 0.13e-3, 0.5) for _ in range(3)] == [10.0, 10.0, 200.0]
    assert followed.fit(10.0, 0.0, 0.5) == 10.0, "a straight beam tells nothing"
    assert followed.fit(10.0, 0.2, 0.5) == 1.0, "never smaller than life"


def test_the_window_follows_the_speed() -> None:
    assert [fitting_window(speed) for speed in (4.0, 1.0, 1 / 16, 1 / 64, 1 / 256)] == [20.0, 5.0, 0.2, 0.1, 0.02]


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize("aspect", [0.46, 1.0, 2.2])
def test_the_whole_floor_is_in_the_picture(name: str, aspect: float) -> None:
    scenario = load_preset(name)
    position, look_at = overview(scenario, Window(aspect))
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    for corner in ((x, y, 0.0) for x in (x_min, x_max) for y in (y_min, y_max)):
        away = np.array(corner) - position
        depth = away @ forward
        assert abs(away @ up) / depth < np.tan(FIELD_OF_VIEW / 2)
        assert abs(away @ right) / depth < aspect * np.tan(FIELD_OF_VIEW / 2)


def test_slider_scales_go_there_and_back() -> None:
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


def test_text_is_escaped_and_cut() -> None:
    assert escaped("<img src=x onerror=alert(1)>") == "&lt;img src=x onerror=alert(1)&gt;"
    assert len(escaped("a" * 1_000_000)) < 3000
    assert number(-0.5) == "−0.5"
    assert number(float("nan")) == "–"
    assert factor(1 / 256) == "1/256 ×"
    assert factor(2.0) == "2 ×"


def test_changes_have_a_sign_unless_there_is_none() -> None:
    assert change_text(150.2) == "+150 %"
    assert change_text(-3.6) == "−4 %"
    assert change_text(-0.2) == change_text(0.4) == "0 %"
    assert change_text(float("nan")) == "–"
