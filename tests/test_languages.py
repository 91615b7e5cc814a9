"""The catalogues of the languages are complete, have the same entries, and hold only texts that flexlab still says."""

import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from pydantic import BaseModel

from flexlab.analysis.modes import MEMORY, ON_THEIR_WAY, POSE
from flexlab.errors import LabError
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.server.pages import catalogues, read_catalogue
from flexlab.server.visitors import checked_name
from flexlab.text import with_indices

COMPLETE = ("de", "zh")
"""Languages that come with flexlab. A new text may be missing in all of them: it is then shown in English."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
MARK = re.compile(r"`|\*\*|\*|\[|\]|<sub>|</sub>")
"""Marks of `static/language.js` for code, bold and italic text, links and subscripts."""
WORDS = re.compile(r"[^\W\d_]{3,}(?:['’-][^\W\d_]+)*")
LOOSE = 8
"""One in so many pairs of words may be missing from the sources."""
OF_VISER = """About Viser; Inactive; Minimize panel; Save Canvas; Reset View; Orbit Origin Tool; Dev Settings; WebGL
Stats; Dark Mode; Show Viser Logo; Log Camera to Console; Show Orbit Crosshair; Device Pixel Ratio; Reset Panel
Layout; Scene tree; Expand column; Collapse column; Expand panel; Collapse panel; Connecting...; Software WebGL
rendering; WebGL is; WebGL unavailable; This may be caused by; Could not detect browser; Your browser; It may not be;
Unsupported browser; Consider updating; Connection rejected; Uploading; File uploaded; Receiving; Received; Search
commands"""
"""First words of texts from viser, whose sources are not searched."""


def test_the_languages_that_come_with_flexlab_have_catalogues() -> None:
    assert set(catalogues()) == set(COMPLETE)
    assert [read_catalogue(catalogues()[code])["English"] for code in COMPLETE] == ["Deutsch", "中文"]


def test_the_catalogues_hold_the_same_texts() -> None:
    first, *others = (read_catalogue(catalogues()[code]) for code in COMPLETE)
    for other in others:
        assert list(other) == list(first)


def test_pages_know_the_code_names_of_all_parts_of_a_scenario(root: Path) -> None:
    script = (root / "flexlab/server/static/language.js").read_text(encoding="utf-8")
    named = re.search(r'PATH = "\(\?:([\w|]+)\)', script)
    assert named
    assert named[1].split("|") == sorted(name for name, part in Scenario() if isinstance(part, BaseModel))


@pytest.mark.parametrize("code", COMPLETE)
def test_no_text_is_given_twice(code: str) -> None:
    pairs = json.loads(catalogues()[code].read_text(encoding="utf-8"), object_pairs_hook=list)
    assert len(pairs) == len(dict(pairs))


@pytest.mark.parametrize("code", COMPLETE)
def test_a_translation_keeps_placeholders_and_marks(code: str) -> None:
    for english, text in read_catalogue(catalogues()[code]).items():
        assert text.strip(), f"{english!r} has no translation"
        assert sorted(PLACEHOLDER.findall(text)) == sorted(PLACEHOLDER.findall(english)), english
        # A page fills in texts between its elements and does not move these.
        assert MARK.findall(text) == MARK.findall(english), english
        for ours, theirs in zip(MARK.split(text), MARK.split(english), strict=True):
            assert theirs or not ours.strip(), f"{english!r} has no place for {ours!r}"


@pytest.mark.parametrize("code", COMPLETE)
def test_numbers_look_the_same_in_all_languages(code: str) -> None:
    for english, text in read_catalogue(catalogues()[code]).items():
        numbers = re.compile(r"\d+[.,]\d+")
        said = numbers.findall(PLACEHOLDER.sub("", text))
        assert not [number for number in said if number not in numbers.findall(english)], english


@pytest.mark.parametrize(("code", "word"), [("de", r"Effektivwert|\(eff\.\)"), ("zh", "均方根")])
def test_root_mean_square_has_one_word(code: str, word: str) -> None:
    for english, text in read_catalogue(catalogues()[code]).items():
        assert (english.count("RMS"), text.count("RMS")) == (len(re.findall(word, text)), 0), english


@cache
def _runs_of_words(root: Path) -> frozenset[tuple[str, ...]]:
    """Return all words, and pairs of neighbouring words, in the sources, guide, pictures and presets of flexlab."""
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
        # The source may put a long sentence together from parts.
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
    assert {"This is not a name", str(caught.value)} <= set(read_catalogue(catalogues()[code]))


@pytest.mark.parametrize("code", COMPLETE)
def test_words_within_sentences_and_tables_are_translated(code: str) -> None:
    said = {POSE, MEMORY, ON_THEIR_WAY, "{folder}, an unknown processor", "Search commands..."}
    assert said <= set(read_catalogue(catalogues()[code]))


SHOWN = """lab server scenario own guide.py presets.py analysis/explanations analysis/identification/free_ring.py
analysis/identification/estimates.py analysis/identification/ring.py analysis/lesson_checks.py
analysis/lesson_expressions.py analysis/metrics/metric.py analysis/replay.py analysis/rest_point.py analysis/resume.py
control recording/codec.py recording/file_sink.py recording/importing.py recording/overlay.py recording/reader.py
recording/recorder.py recording/repair.py recording/store/run_index.py recording/table_columns.py sim/commands.py
sim/run_warnings.py sim/runner.py sim/samples.py sim/step_size.py sim/target.py sim/termination.py""".split()
"""Sources of sentences that a page may show."""
UNSEEN = {
    "in the terminal, as the server starts": """server/settings.py; server/front_server.py; ◦ is not set: a JupyterHub;
    law = ◦ is not an address; What is printed beyond ◦; MB is left out""",
    "in the log": "server/labs/preloaded.py; lab/viser_internals.py: This is not a message",
    "by commands that ask, or that fit and set": """analysis/replay.py: the program at ◦; analysis/replay.py: the unit ◦;
    analysis/replay.py: ◦, Python code of ◦ lines; Let it run here; Connect to it;
    The run was controlled by the unit; The run was not replayed; scenario/settings.py; ◦ is not a signal that rings;
    ◦ has no samples after ◦ s in which""",
    "to who calls flexlab from Python": """changes = ◦ is not usable; own/files.py: The; ◦ is not a scenario: give a Scenario;
    control/law.py; control/path.py; samples have no signal""",
    "in files": "presets.py: Where; presets.py: Format; presets.py: Place; own/unit.py: ◦: computed by the unit",
}
"""Where sentences that no page shows are shown instead → their sources, or their first words."""
HOLE = "◦"
"""Stands for a value in a sentence of a source."""
VALUE = f"(?:.{{1,16}}|.{{0,12}}{HOLE}.{{0,12}})"
"""What a placeholder of an entry may hold in a sentence of a source."""
UNTOLD = re.compile(r"(log|warnings)\..*|.*(Value|Runtime|Type|Key|Import|Connection)Error")
"""Calls whose texts are for the log, or for programmers."""


def _text_of(node: ast.AST) -> str:
    """Return a text in a source, with holes for its values; empty for a node that is no text."""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else HOLE for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add) and (_text_of(node.left) or _text_of(node.right)):
        return (_text_of(node.left) or HOLE) + (_text_of(node.right) or HOLE)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _sentences(node: ast.AST) -> Iterator[str]:
    """Yield the texts in a part of a source that end like sentences, without docstrings."""
    is_docstring = isinstance(node, ast.Expr) and _text_of(node.value)
    if is_docstring or (isinstance(node, ast.Call) and UNTOLD.fullmatch(ast.unparse(node.func))):
        return
    text = " ".join(re.sub("<[^>]*>", "", _text_of(node)).split())
    if text[-1:] in (".", "!", "?") and len(WORDS.findall(text)) > 2:
        yield text
    for part in () if text else ast.iter_child_nodes(node):
        yield from _sentences(part)


def test_every_sentence_that_a_page_may_show_is_translated(root: Path) -> None:
    keys = list(read_catalogue(catalogues()["de"]))
    forms = [VALUE.join(map(re.escape, re.split(r"\{\w+\}", key))) for key in keys]
    known = re.compile("|".join(form for form in forms if WORDS.search(form)))
    unseen = tuple("; ".join(" ".join(told.split()) for told in UNSEEN.values()).split("; "))

    def is_translated(text: str) -> bool:
        """Whether a text is an entry, or a part of one, in which its holes may stand for any words."""
        text = with_indices(text)  # As the lab shows conditions and fields.
        return bool(known.fullmatch(text) or re.search(".*".join(map(re.escape, text.split(HOLE))), "\n".join(keys)))

    lacking: list[str] = []
    for place in (root / "flexlab" / place for place in SHOWN):
        for file in [place] if place.suffix else sorted(place.rglob("*.py")):
            for text in _sentences(ast.parse(file.read_text(encoding="utf-8"))):
                parts = [] if is_translated(text) else re.split(r"(?<=[.!?✓◦]) (?=[A-Z\d◦])", text)
                name = file.relative_to(root / "flexlab").as_posix()
                lacking += [f"{name}: {part}" for part in parts if not is_translated(part)]
    lacking = [
        told for told in lacking if not told.startswith(unseen) and not told.partition(": ")[2].startswith(unseen)
    ]
    assert not lacking, "these lack in web_assets/languages/*.json:\n" + "\n".join(lacking)
