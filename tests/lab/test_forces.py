"""Arrows of forces at the grips, in a real scene."""

import numpy as np
import pytest

from flexlab.lab import colors
from flexlab.lab.scene.forces import StraightArrows
from flexlab.lab.session import Session
from flexlab.presets import load_preset


@pytest.mark.parametrize("length", [0.25, 0.5, 1.0])
def test_arrows_of_two_grips_that_press_never_meet(lasting_session: Session, length: float):
    """Heads that passed each other looked like a pull."""
    scenario = load_preset("paper").replace({"payload.length": length})
    arrows = StraightArrows(lasting_session.server.scene, "/pressed", colors.INTERNAL_FORCE, scenario, 0.1)
    grips = np.array([[-length / 2, 0.5], [length / 2, 0.5]])
    for force in (0.5, 9.9, 40.0, 490.0):
        arrows.update(grips, np.array([[force, 0.0], [-force, 0.0]]), shown=True)
        assert force / arrows.per_meter < 0.5 * length
    lasting_session.server.scene.remove_by_name("/pressed")


def test_an_arrow_that_appears_is_where_its_force_is(lasting_session: Session):
    """A browser shows a hidden arrow at once and moves it a picture later: it flashed where it had last been seen."""
    arrows = StraightArrows(lasting_session.server.scene, "/fading", colors.INTERNAL_FORCE, load_preset("paper"), 0.1)
    there, elsewhere = np.array([[0.0, 0.0], [0.5, 0.0]]), np.array([[0.3, 0.2], [0.8, 0.2]])
    arrows.update(there, np.array([[1.0, 0.0], [-1.0, 0.0]]), shown=True)
    assert arrows._handle.visible
    arrows.update(elsewhere, np.array([[0.001, 0.0], [-0.001, 0.0]]), shown=True)
    assert not arrows._handle.visible
    assert np.allclose(arrows._handle.points[:, 0, :2], elsewhere)
