"""`flexlab validate` passes for this package, but not for one with a flipped sign."""

import ast
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from planted_errors import PLANTED, PlantedError, planted_text

from flexlab.analysis.leaderboard.board import make_tasks
from flexlab.analysis.leaderboard.case import chosen_cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.store import shipped_rows
from flexlab.analysis.validation import Validation, validate
from flexlab.analysis.validation.beam import closed_form
from flexlab.analysis.validation.check import Group, Runs, above, below, close
from flexlab.analysis.validation.mass_points import time_derivative
from flexlab.analysis.validation.mechanics import mass_points
from flexlab.analysis.validation.report import write_report
from flexlab.control.law import laws
from flexlab.control.motion import Shaper
from flexlab.control.path import paths
from flexlab.errors import StudyError
from flexlab.physics import beam
from flexlab.scenario.payload import NodalDamping


@pytest.fixture(scope="module")
def validation() -> Validation:
    return validate()


def test_every_statement_holds(validation: Validation):
    assert [check for check in validation.checks if not check.holds] == []
    assert len(validation.checks) > 160
    assert list(validation.groups) == [
        "Section IV again", "The beam in closed form", "Mechanics of mass points", "Control law and internal force",
        "Energy and convergence", "Theorems 1 and 2 along the run", "Every control law", "Paths and input shapers",
        "Waypoints",
        "The sampled loop and its sensors", "Observers and the regulator", "The force along the beam",
        "Joints that are not ideal", "Encoders", "Motors", "A payload that is filled or emptied", "Grips that give way",
        "Numbers that sum up a run", "Linear models, margins and identified beams",
        "Conditions of the laws", "Numerical building blocks", "Sampled linear models", "Sentences on a run",
        "Exported bodies and figures", "Tables, files and plots", "The environment for learning",
        "The published leaderboard",
    ]  # fmt: skip


def test_every_law_and_every_variant_of_a_case_has_a_published_row(validation: Validation):
    """If such a statement fails after a change of the engine, make the table anew with `web_assets/make/leaderboard.py`."""
    said = [check.statement for check in validation.groups["The published leaderboard"]]
    tasks = make_tasks(chosen_cases(None, long=False), chosen_entrants(None))
    assert {row.place for row in shipped_rows()} == {task.row.place for task in tasks}
    assert {text.split(" in ")[0] for text in said} == {task.row.law for task in tasks}
    assert len(said) == len({task.row.place[:2] for task in tasks})


def test_every_law_path_and_shaper_of_flexlab_has_a_statement(validation: Validation):
    said = " ".join(check.statement for check in validation.checks)
    own = [kind for kind, law in laws().items() if law.kernel.__module__.startswith("flexlab.")]
    otherwise = {"adaptive-sliding-mode": "u_i of Eqs. (23), (25)", "none": "its motors, which are off, do no work"}
    words = {name: re.escape(otherwise.get(name, name)) for name in (*own, *paths(), *get_args(Shaper))}
    assert [name for name, text in words.items() if not re.search(rf"(?<![\w-]){text}(?![\w-])", said)] == []


def test_there_are_at_least_forty_errors_each_with_its_own_name():
    assert len({error.name for error in PLANTED}) == len(PLANTED) >= 40


def test_the_report_has_the_table_and_four_figures_and_needs_no_network(validation: Validation, tmp_path: Path):
    write_report(validation, tmp_path / "a" / "report.html", 1.0)
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert f"All {len(validation.checks)} statements hold." in page
    assert re.findall(r"Figure (\d)\.", page) == ["2", "3", "4", "5"]
    assert page.count("<svg") == 4
    assert not re.search(r"(src|href)=.https?:", page.replace("http://www.w3.org", ""))
    assert len(page) < 3e6
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(StudyError, match="cannot be written"):
        write_report(validation, tmp_path / "file" / "report.html", 1.0)


def test_the_command_prints_the_table_as_json_and_writes_the_report(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]],
    validation: Validation,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    """The validation is computed once for all tests; with the errors of `planted_errors.py`, the command computes it."""
    monkeypatch.setattr("flexlab.analysis.validation.validate", lambda: validation)
    done = flexlab_command("validate", "--json", "--to", "mine.html")
    assert done.returncode == 0, done.stderr
    groups = json.loads(done.stdout)
    assert all(check["holds"] for checks in groups.values() for check in checks)
    assert (tmp_path / "mine.html").exists()


@pytest.mark.parametrize("error", PLANTED, ids=lambda error: error.name)
def test_every_error_can_still_be_planted(error: PlantedError):
    ast.parse(planted_text(error))


def flipped_stiffness(circumstances: pytest.MonkeyPatch) -> None:
    right = beam.curvature_functions
    circumstances.setattr(beam, "curvature_functions", lambda xi, length: right(xi, length) * (1, 1, -1, 1))


def flipped_damping(circumstances: pytest.MonkeyPatch) -> None:
    circumstances.setattr(NodalDamping, "modal", lambda self, omega, V: -self.coefficient * (V.T @ V))


def forget_what_is_known() -> None:
    """Clear the engine's caches."""
    engine = tuple(f"flexlab.{room}." for room in ("physics", "control", "sim"))
    for module in [module for name, module in sys.modules.items() if name.startswith(engine)]:
        for each in vars(module).values():
            if hasattr(each, "cache_clear"):
                each.cache_clear()


@pytest.fixture
def nothing_known() -> Iterator[None]:
    """Empty caches before and after: no cached beam hides a planted error, and no beam with one is left to other tests."""
    forget_what_is_known()
    yield
    forget_what_is_known()


@pytest.mark.usefixtures("nothing_known")
@pytest.mark.parametrize(("plant", "group"), [(flipped_stiffness, closed_form), (flipped_damping, mass_points)])
def test_a_flipped_sign_that_needs_no_compiling_does_not_pass(
    plant: Callable[[pytest.MonkeyPatch], None], group: Group, monkeypatch: pytest.MonkeyPatch
):
    """All others take up to a minute each: see `planted_errors.py`."""
    plant(monkeypatch)
    assert not all(check.holds for check in group(Runs()))


def test_a_report_that_cannot_be_written_is_refused_at_once(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("flexlab.analysis.validation.validate", lambda: pytest.fail("it was computed for nothing"))
    (tmp_path / "taken.html").mkdir()
    (tmp_path / "file").touch()
    for place in ("taken.html", "file/report.html", "file"):
        done = flexlab_command("validate", "--to", place)
        assert (done.returncode, done.stdout) == (2, "")
        assert "cannot be written" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "taken.html"], "no draft is left"


def test_the_command_says_what_does_not_hold(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]],
    validation: Validation,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    wrong = Validation({**validation.groups, "More": (close("one is two", 1.0, 2.0),)}, validation.runs)
    monkeypatch.setattr("flexlab.analysis.validation.validate", lambda: wrong)
    done = flexlab_command("validate", "--to", "report.html")
    assert done.returncode == 1
    assert "do not trust what this installation computes" in done.stderr
    assert re.search(r"one is two .* NO\b", done.stdout)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"1 of {len(wrong.checks)} statements do not hold." in page
    assert re.search(r'<td>one is two</td>.*\n<td class="bad">no</td>', page)


def test_a_check_of_nan_or_infinity_never_holds():
    for number in (np.nan, np.inf):
        assert not close("", 1.0, number, relative=0.5).holds
        assert not below("", 1.0, number).holds
    assert not above("", 1.0, np.nan).holds
    assert close("", 1.0, 1.01, relative=0.02).holds
    assert not close("", 1.0, 1.03, relative=0.02).holds


def test_the_time_derivative_is_of_fourth_order():
    errors = []
    for period in (0.02, 0.01):
        t = np.arange(20) * period
        errors.append(np.abs(time_derivative(np.sin(t), period) - np.cos(t[2:-2])).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.2)
