"""The guide is complete: chapters, lessons and pictures exist, fit together, and stay small."""

import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from flexlab import guide
from flexlab.analysis.lesson_checks import read_check
from flexlab.assets import web_assets_folder
from flexlab.lab.view_settings import tamed_exaggeration
from flexlab.presets import load_preset, preset_names
from flexlab.scenario.field_text import options
from flexlab.sim.simulate import simulate
from flexlab.text import number_text
from flexlab.views import fitting_exaggeration

CHAPTERS = [
    "What you see",
    "The equations",
    "The controller",
    "The rivals",
    "Sliding-mode laws",
    "Model-based laws",
    "Feedback alone",
    "Vibration control",
    "The force along the beam",
    "Grips that give way",
    "Joints that are not ideal",
    "Reading the plots",
    "Keys and tips",
    "Paths and shapers",
]
LESSONS = [
    "Why does it ring?",
    "Soft beam",
    "What ε does",
    "Why adaptive?",
    "Internal force",
    "Can vibration reach zero?",
    "Stopping without a ring",
    "Spillover",
    "A squeeze until it buckles",
    "Spin-up",
]
SVG = "{http://www.w3.org/2000/svg}"
PICTURES = sorted(file for name in ("guide", "pictures") for file in (web_assets_folder() / name).rglob("*.svg"))


def texts() -> list[tuple[str, str]]:
    """Return (name, markdown) of all chapters and lessons."""
    found = [(chapter.id, chapter.text) for chapter in guide.chapters()]
    return found + [(lesson.id, lesson.text) for lesson in guide.lessons()]


def test_chapters_and_lessons_come_in_this_order():
    assert [chapter.title for chapter in guide.chapters()] == CHAPTERS
    assert [lesson.title for lesson in guide.lessons()][: len(LESSONS)] == LESSONS
    ids = [name for name, _ in texts()]
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("lesson", guide.lessons(), ids=lambda lesson: lesson.id)
def test_a_lesson_has_all_its_parts(lesson: guide.Lesson):
    assert lesson.preset in preset_names()
    read_check(lesson)
    assert lesson.question
    assert re.match(r"1\. ", lesson.steps)
    assert lesson.observe
    assert lesson.guess.endswith("?")
    assert lesson.answer in lesson.options


@pytest.mark.parametrize(("name", "text"), texts())
def test_texts_name_presets_paths_shapers_fields_and_pictures_that_exist(name: str, text: str):
    for word in re.findall(r"preset `([^`]+)`", text.replace("\n", " ")):
        assert word in preset_names()
    known = {*preset_names(), *options("trajectory.kind"), *options("trajectory.shaper")}
    for word in re.findall(r"`([a-z][\w.-]*)`", text):
        assert load_preset("paper").has(word) if "." in word else word in known, word
    assert "![" not in text, "a picture that was not found"
    assert "[symbols" not in text


@pytest.mark.parametrize(("name", "text"), texts())
def test_texts_hold_no_html_but_pictures_and_subscripts(name: str, text: str):
    bare = re.sub(r"<div style=.*?</svg></div>|</?sub>", "", text)
    assert "<" not in bare
    assert "\n\n" not in "".join(re.findall(r"<div style=.*?</div>", text, re.S)), "an empty line ends HTML in markdown"


def test_every_equation_is_shown():
    shown = "".join((guide.guide_folder() / file.name).read_text("utf-8") for file in guide.guide_folder().glob("*.md"))
    for file in (guide.guide_folder() / "equations").glob("*.svg"):
        assert f"(equations/{file.name})" in shown


def test_symbol_tables_come_from_the_symbol_table():
    table = guide.symbol_table(["s", "EI"])
    assert "| s | sliding variable | m/s, m/s, rad/s |" in table
    assert "| EI | bending stiffness | N·m² |" in table
    with pytest.raises(KeyError):
        guide.symbol_table(["no symbol"])


def test_a_file_that_is_no_lesson_is_refused(tmp_path: Path):
    file = tmp_path / "1-broken.md"
    file.write_text("# no head\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"1-broken\.md is not a lesson: line 1: a lesson begins with a line ---"):
        guide._lesson(file)


@pytest.mark.parametrize("file", PICTURES, ids=lambda file: file.stem)
def test_a_picture_is_a_small_and_safe_svg(file: Path):
    assert file.stat().st_size < 40_000
    root = ET.fromstring(file.read_text(encoding="utf-8"))
    assert root.tag == f"{SVG}svg"
    assert {"width", "height", "viewBox"} <= set(root.attrib)
    for element in root.iter():
        assert element.tag.removeprefix(SVG) in {"svg", "g", "path", "circle", "line", "rect", "text", "title", "tspan"}
        assert "id" not in element.attrib, "two pictures on one page would share it"
        assert not any(name.startswith("on") or name.endswith("href") for name in element.attrib)


def test_every_preset_has_a_picture_that_exaggerates_as_the_lab_does():
    for preset in preset_names():
        scenario = load_preset(preset)
        run = simulate(scenario, 3.0, 0.001)
        bending = run.midspan_deflection if len(scenario.arms) == 2 else run.beam_coordinates[:, -2]
        fitting = fitting_exaggeration(scenario)
        factor = tamed_exaggeration(fitting, float(np.abs(bending).max()), scenario.payload.length)
        file = web_assets_folder() / "pictures" / f"{preset}.svg"
        assert file.is_file(), f"run web_assets/make/pictures.py for {preset}"
        words = "".join(ET.fromstring(file.read_text(encoding="utf-8")).itertext())
        assert f"deflection drawn × {number_text(factor)}" in words, preset


@pytest.mark.parametrize("name", ["equations", "leaderboard", "models", "notebooks", "pictures"])
def test_the_scripts_that_make_shipped_files_load(root: Path, name: str):
    runpy.run_path(str(root / f"web_assets/make/{name}.py"))


def test_a_presets_picture_is_what_the_script_draws(root: Path):
    made = runpy.run_path(str(root / "web_assets/make/pictures.py"))
    shipped = web_assets_folder() / "pictures" / "paper.svg"
    assert made["draw_preset"]("paper") == shipped.read_text(encoding="utf-8"), "run web_assets/make/pictures.py"


def test_three_dimensional_models_are_small_and_described():
    folder = web_assets_folder() / "models"
    files = sorted(folder.glob("*.glb"))
    assert files
    assert sum(file.stat().st_size for file in files) < 200_000
    described = (folder / "README.md").read_text(encoding="utf-8")
    for file in files:
        assert file.read_bytes()[:4] == b"glTF"
        assert file.name in described
