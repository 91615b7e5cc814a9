"""The catalogues of the languages: whole, alike, and of texts that flexlab still says."""

import ast
import json
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from flexlab.errors import LabError
from flexlab.presets import load_preset, preset_names
from flexlab.server.pages.templating import catalogues, read_catalogue
from flexlab.server.visitors import checked_name

COMPLETE = ("de", "zh")
"""Languages that come with flexlab. A text that is new may lack in all of them: it is shown in English."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
MARK = re.compile(r"`|\*\*|\*|\[|\]|<sub>|</sub>")
"""What a page has in bold, as code, as a link or as an index, in the marks of `static/language.js`."""
WORDS = re.compile(r"[^\W\d_]{3,}(?:['’-][^\W\d_]+)*")
LOOSE = 8
"""Of so many pairs of words one may be said apart."""
OF_VISER = """About Viser; Inactive; Minimize panel; Save Canvas; Reset View; Orbit Origin Tool; Dev Settings; WebGL Stats;
Dark Mode; Show Viser Logo; Log Camera to Console; Show Orbit Crosshair; Device Pixel Ratio; Reset Panel Layout; Scene tree;
Expand column; Collapse column; Expand panel; Collapse panel; Connecting...; Software WebGL rendering; WebGL is running"""
"""Beginnings of texts that viser says, whose page is packed."""


def test_the_languages_that_come_with_flexlab_are_there() -> None:
    assert set(catalogues()) == set(COMPLETE)
    assert [read_catalogue(catalogues()[code])["English"] for code in COMPLETE] == ["Deutsch", "中文"]


def test_the_catalogues_hold_the_same_texts() -> None:
    first, *others = (read_catalogue(catalogues()[code]) for code in COMPLETE)
    for other in others:
        assert list(other) == list(first)


@pytest.mark.parametrize("code", COMPLETE)
def test_no_text_is_given_twice(code: str) -> None:
    pairs = json.loads(catalogues()[code].read_text(encoding="utf-8"), object_pairs_hook=list)
    assert len(pairs) == len(dict(pairs))


@pytest.mark.parametrize("code", COMPLETE)
def test_placeholders_and_marks_stay(code: str) -> None:
    for english, text in read_catalogue(catalogues()[code]).items():
        assert text.strip(), f"{english!r} has no translation"
        assert sorted(PLACEHOLDER.findall(text)) == sorted(PLACEHOLDER.findall(english)), english
        # A page puts texts between its elements, and moves none of them.
        assert MARK.findall(text) == MARK.findall(english), english
        for ours, theirs in zip(MARK.split(text), MARK.split(english), strict=True):
            assert theirs or not ours.strip(), f"{english!r} has no place for {ours!r}"


@pytest.mark.parametrize("code", COMPLETE)
def test_numbers_look_the_same_in_all_languages(code: str) -> None:
    for english, text in read_catalogue(catalogues()[code]).items():
        numbers = re.compile(r"\d+[.,]\d+")
        said = numbers.findall(PLACEHOLDER.sub("", text))
        assert not [number for number in said if number not in numbers.findall(english)], english


@cache
def _runs_of_words(root: Path) -> frozenset[tuple[str, ...]]:
    """All words, and pairs of words, that sources, lessons and presets of flexlab hold."""
    package, assets = root / "flexlab", root / "web_assets"
    texts: list[str] = []
    for file in package.rglob("*.py"):
        texts += [
            node.value
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        ]
    for preset in preset_names():
        texts += [load_preset(preset).title, load_preset(preset).watch]
    kinds = ((package, "*.js"), (package, "*.html"), (assets / "guide", "*.md"), (assets / "pictures", "*.svg"))
    for folder, kind in kinds:
        texts += [
            re.sub(r'"\s*\+\s*"|" \+\s+["`]|[`"] \+\s+["`]', "", file.read_text(encoding="utf-8"))
            for file in folder.rglob(kind)
        ]
    found: set[tuple[str, ...]] = set()
    for text in texts:
        words = WORDS.findall(re.sub(r"\$\{|\{[{%]|[%}]\}|</?[a-z]+\d?>", " ", text).lower())
        found.update((word,) for word in words)
        found.update(pairwise(words))
    return frozenset(found)


def test_every_text_of_the_catalogues_is_still_said(root: Path) -> None:
    said = _runs_of_words(root)
    stale = []
    viser = tuple(" ".join(OF_VISER.split()).split("; "))
    for english in (text for text in read_catalogue(catalogues()["de"]) if not text.startswith(viser)):
        sought: list[tuple[str, ...]] = []
        for part in re.split(r"\{\w+\}|[\[\]`*()]|</?[a-z]+>|(?<=[.:;,?!]) ", english):
            words = WORDS.findall(part.lower())
            sought += pairwise(words) if len(words) > 1 else [(word,) for word in words]
        # A long sentence may be put together where it is said.
        if sum(words not in said for words in sought) > len(sought) // LOOSE:
            stale.append(english)
    assert not stale, (
        "flexlab says these no more: take them out of web_assets/languages/*.json, or write what it says now"
    )


@pytest.mark.parametrize("code", COMPLETE)
@pytest.mark.parametrize("name", ["Ann\x07", "\u202eAnn"])
def test_a_refused_name_is_refused_in_the_visitors_language(code: str, name: str) -> None:
    with pytest.raises(LabError) as caught:
        checked_name(name)
    assert {"This is no name", str(caught.value)} <= set(read_catalogue(catalogues()[code]))
