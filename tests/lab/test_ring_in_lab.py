"""A tap in a running lab: its ring is fitted, and each remedy is taken up as one change that can be undone."""

import pytest
from lab_page import wait_until

from flexlab.errors import LabError
from flexlab.lab.panel.ring_panel import RingPanel
from flexlab.lab.session import Session
from flexlab.lab.widgets import Widgets
from flexlab.presets import load_preset
from flexlab.sim.commands import StepOnce, Tap


def test_the_fitted_ring_of_a_tap_gives_a_shaper_and_a_gain():
    scenario = load_preset("paper").replace({"trajectory.kind": "hold", "controller.kind": "vibration-damping"})
    scenario = scenario.replace({"controller.lateral_vibration_gain": 5.0})
    with Session(scenario, shadows=False, playing=False) as lab:
        panel = RingPanel(Widgets(lab.server.gui, lab.lab_state))
        state = lab.lab_state

        def fitted() -> None:
            panel.fit()
            wait_until(lambda: not panel.is_busy, "the fit")
            panel.update(lab.runner.snapshot)

        fitted()
        assert "There is no free ring to fit: tap the beam" in panel._found.content
        assert not any(button.visible for button in panel._shapers)
        with pytest.raises(LabError, match="Fit a ring first"):
            panel._use("zv")
        state.submit(Tap(0.0, (0.0, 0.05)))
        state.submit(StepOnce(400))
        wait_until(lambda: lab.runner.snapshot.latest.time[0] >= 0.4, "the ring")
        fitted()
        result = panel.result
        assert result is not None
        assert result.remedies is not None
        assert result.fit.first.frequency.value == pytest.approx(45.0, rel=0.05)
        assert "95 % within" in panel._found.content
        assert all(button.visible for button in panel._shapers)
        assert panel._damp.visible

        panel._use("zvd")
        path = state.intended.trajectory
        assert (path.shaper, path.shaper_frequency) == ("zvd", result.remedies.frequency)
        wait_until(lambda: lab.runner.snapshot.scenario.trajectory == path, "the engine takes it up")
        state.undo()
        assert state.intended.trajectory.shaper == "none"
        panel._use_gain()
        assert state.intended.controller.lateral_vibration_gain == pytest.approx(result.remedies.gain, rel=1e-3)
        state.change({"controller.kind": "pd"})
        panel.update(lab.runner.snapshot)
        assert not panel._damp.visible
        with pytest.raises(LabError, match="choose vibration-damping or composite"):
            panel._use_gain()
