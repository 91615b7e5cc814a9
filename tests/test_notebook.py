"""What notebooks show: a run as a page, a live lab in a cell."""

import urllib.request

import pytest

import flexlab
from flexlab.errors import PresetError
from flexlab.sim.commands import ChangeScenario


def test_a_run_is_a_page_in_a_cell():
    page = flexlab.simulate("paper", 0.5).show()
    assert "<title>paper – flexlab</title>" in page.html
    assert page._repr_html_().startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert repr(page).endswith("MB: a notebook shows it; .html is its text>")


def test_a_lab_lives_as_long_as_its_block():
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
