"""What the guide for contributors names exists."""

import re
from pathlib import Path

import pytest

DOCUMENTS = (".github/CONTRIBUTING.md", ".github/CHANGELOG.md")


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_file_that_is_named_exists(root: Path, document: str):
    text = (root / document).read_text(encoding="utf-8")
    named = re.findall(r"`((?:flexlab|tests|presets|web_assets|\.github|\.ci)/[\w./-]*)`", text)
    assert named
    assert [path for path in named if not (root / path).exists()] == []


def test_the_table_of_what_can_be_added_has_every_kind(root: Path):
    rows = re.findall(r"^\| (a \w[^|]*) \|", (root / DOCUMENTS[0]).read_text(encoding="utf-8"), re.MULTILINE)
    words = " ".join(rows)
    assert all(word in words for word in ("law", "signal", "path", "damping", "metric", "lesson")), rows
