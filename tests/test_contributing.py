"""What the guide for contributors names exists."""

import re
from pathlib import Path

import pytest

DOCUMENTS = (".github/CONTRIBUTING.md", ".github/CHANGELOG.md")
SEARCHED = re.compile(r'(?:modules_in|Registry)\([^)]*?(__name__|"flexlab\.[\w.]+")')
"""A package whose modules flexlab finds by itself."""


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_file_that_is_named_exists(root: Path, document: str):
    text = (root / document).read_text(encoding="utf-8")
    named = re.findall(r"`((?:flexlab|tests|presets|web_assets|\.github|\.ci)/[\w./-]*)`", text)
    assert named
    assert [path for path in named if not (root / path).exists()] == []


def test_the_table_of_what_can_be_added_has_every_folder_that_is_searched_for_additions(root: Path):
    rows = re.findall(r"^\| an? .+\|$", (root / DOCUMENTS[0]).read_text(encoding="utf-8"), re.MULTILINE)
    searched = {"flexlab/cli", "presets", "web_assets/languages", "web_assets/guide/lessons"}
    for file in (root / "flexlab").rglob("*.py"):
        for package in SEARCHED.findall(file.read_text(encoding="utf-8")):
            named = package.strip('"').replace(".", "/")
            searched.add(file.parent.relative_to(root).as_posix() if package == "__name__" else named)
    assert len(searched) > 10
    assert [folder for folder in searched if not any(f"`{folder}/" in row for row in rows)] == []
    assert {row.count("|") for row in rows} == {6}, "what, how many files, what to write, what to copy, the test"
