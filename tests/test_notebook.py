"""What notebooks show: a run as a page, a live lab in a cell."""

import urllib.request
from pathlib import Path

import numpy as np
import pytest
from waiting import wait_until

import flexlab
from flexlab.errors import PresetError
from flexlab.sim.commands import ChangeScenario


class OfACell(flexlab.OwnLaw):
    """PD."""

    stiffness = flexlab.gain(2e4, "N/m", low=0, high=1e5)

    def act(self, at):
        error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights + at.shared(-self.stiffness * error - 800.0 * error_rate)


class AlongX(flexlab.OwnPath):
    """There and back."""

    period = 2.0

    def position(self, t):
        return 0.05 * np.sin(np.pi * t), 0.75, 0.0


def test_a_law_or_path_defined_in_a_cell_works_wherever_scenarios_do(tmp_path: Path):
    run = flexlab.simulate("paper", 0.1, law=OfACell, path=AlongX, check=True)
    many = flexlab.simulate_many(["paper", {}, {"gravity": 99}], 0.1, progress=False, law=OfACell, path=AlongX)
    assert [str(one.status) for one in many] == ["finished", "finished", "invalid"]
    np.testing.assert_array_equal(many[0].pose, run.pose)
    vary = {"controller.kind": [OfACell, "pd"], "payload.bending_stiffness": [10.0, 20.0]}
    swept = flexlab.sweep("paper", vary, 0.05, folder=tmp_path / "a", progress=False, path=AlongX)
    assert swept.table.column("status").to_pylist() == ["finished"] * 4
    gains = flexlab.sweep("paper", ["controller.stiffness=1e4:2e4:2"], 0.05, folder=tmp_path / "b", law=OfACell)
    assert gains.table.column("status").to_pylist() == ["finished"] * 2
    with flexlab.Lab("paper", law=OfACell, path=AlongX) as lab:
        assert lab.session.runner.snapshot.scenario.controller.kind == "of-a-cell"
        wait_until(lambda: lab.session.runner.snapshot.latest.time[0] > 0.05, "motion under the law")
        assert lab.session.runner.snapshot.scenario.trajectory.kind == "along-x"


def test_a_notebook_shows_a_run_as_a_page():
    page = flexlab.simulate("paper", 0.5).show()
    assert "<title>paper – flexlab</title>" in page.html
    assert page._repr_html_().startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert repr(page).endswith("MB: a notebook shows it; .html is its text>")


def test_a_lab_is_open_only_inside_its_with_block():
    with flexlab.Lab("soft-beam") as lab:
        assert f'src="{lab.url}"' in lab._repr_html_()
        assert repr(lab) == f"<Lab of soft-beam: open at {lab.url}>"
        with urllib.request.urlopen(lab.url, timeout=30) as answer:
            assert answer.status == 200
        lab.session.runner.submit(ChangeScenario({"payload.bending_stiffness": 3.0}))
        url = lab.url
    assert repr(lab) == "<Lab of soft-beam: not open>"
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url, timeout=5)
    lab.close()
    with pytest.raises(PresetError):
        flexlab.Lab("papr")
