"""Arrows of forces at the grips, in a real scene."""

from typing import Any

import numpy as np
import pytest

from flexlab.lab.scene.forces import AWAY, INTERNAL_FORCE, BentArrows, StraightArrows
from flexlab.lab.session import Session
from flexlab.lab.view_settings import ViewSettings
from flexlab.presets import load_preset
from flexlab.sim.commands import Pull


@pytest.mark.parametrize("length", [0.25, 0.5, 1.0])
def test_arrows_of_two_grips_that_press_never_meet(lasting_session: Session, length: float):
    """Arrow heads that passed each other looked like a pull."""
    scenario = load_preset("paper").replace({"payload.length": length})
    arrows = StraightArrows(lasting_session.server.scene, "/pressed", INTERNAL_FORCE, scenario, 0.1)
    grips = np.array([[-length / 2, 0.5], [length / 2, 0.5]])
    for force in (0.5, 9.9, 40.0, 490.0):
        arrows.update(grips, np.array([[force, 0.0], [-force, 0.0]]), shown=True)
        assert force / arrows.per_meter < 0.5 * length
    lasting_session.server.scene.remove_by_name("/pressed")


def test_a_hidden_arrow_moves_with_its_force(lasting_session: Session):
    """A browser shows a hidden arrow at once and moves it a picture later, so it used to flash at its old place."""
    arrows = StraightArrows(lasting_session.server.scene, "/fading", INTERNAL_FORCE, load_preset("paper"), 0.1)
    there, elsewhere = np.array([[0.0, 0.0], [0.5, 0.0]]), np.array([[0.3, 0.2], [0.8, 0.2]])
    arrows.update(there, np.array([[1.0, 0.0], [-1.0, 0.0]]), shown=True)
    assert arrows._handle.visible
    arrows.update(elsewhere, np.array([[0.001, 0.0], [-0.001, 0.0]]), shown=True)
    assert not arrows._handle.visible
    assert np.allclose(arrows._handle.points[:, 0, :2], elsewhere)


def test_arrows_that_are_switched_off_wait_out_of_sight(lasting_session: Session):
    scene, paper = lasting_session.server.scene, load_preset("paper")
    places, force, moment = (
        np.array([[0.0, 0.0], [0.5, 0.0]]),
        np.array([[9.0, 0.0], [-9.0, 0.0]]),
        np.array([3.0, 3.0]),
    )
    straight = StraightArrows(scene, "/straight", INTERNAL_FORCE, paper, 0.1)
    bent = BentArrows(scene, "/bent", INTERNAL_FORCE, 2, 1.0, 0.1)
    for arrows, load in ((straight, force), (bent, moment)):
        for shown in (False, True, False):
            arrows.update(places, load, shown=shown)
            assert arrows._handle.visible is shown
            assert (np.abs(arrows._handle.points[..., 2] - AWAY[2]).max() < 1e-3) is not shown
    scene.remove_by_name("/straight")
    scene.remove_by_name("/bent")


def test_the_arrow_of_a_pull_waits_out_of_sight(lasting_session: Session):
    arrow: Any = lasting_session._scene._pull
    snapshot = lasting_session.runner.snapshot
    for pull in (None, Pull(0.25, (0.0, 0.9), 100.0), None):
        arrow.update(snapshot.scenario, snapshot.latest, ViewSettings(), pull)
        assert arrow._arrow.visible is arrow._label.visible is (pull is not None)
        assert bool(arrow._arrow.points[0, 0, 2] == AWAY[2]) is (pull is None)
        assert bool(arrow._label.text) is (pull is not None)
