"""The guide that the lab shows: chapters and lessons, read from markdown in `web_assets/guide`.

A line `![alt](file.svg)` becomes the picture itself (inline SVG takes the page's text colour, and no page shows it smaller
than it is); a line `[symbols: x e …]` becomes a table of those symbols from `flexlab.notation`; in a table's first column
`x_d` becomes x with an index. All texts are flexlab's own: nothing that a person typed gets into them.
"""

import html
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from flexlab import notation
from flexlab.assets import web_assets_folder
from flexlab.errors import FlexlabError

_PICTURE = re.compile(r"^!\[([^\]]*)\]\(([\w./-]+\.svg)\)$", re.MULTILINE)
_SYMBOLS = re.compile(r"^\[symbols: ([^\]]+)\]$", re.MULTILINE)
_INDEXED = re.compile(r"^\| ([^|_`\s]+)_(\w+) \|", re.MULTILINE)
HEAD_LINE, GUESS, DO, OBSERVE, CHECK = "---", "## Guess", "## Do", "## Observe", "## Check"
"""Lines that separate the parts of a lesson."""
PARTS = {GUESS: "guess", DO: "steps", OBSERVE: "observe", CHECK: "check"}
_OPTION = re.compile(r"^- \[([ x])\] (.+)$", re.MULTILINE)
STEPS = ("guess", "do", "observe")
"""Steps of a lesson in order; step 1 is the first."""
NEEDED = ("title", "preset")
FIELDS = (*NEEDED, "check", "exaggeration", "hint")
"""Fields of a lesson's head. Those not in `NEEDED` may be left out; rules after a line ## Check may replace the check."""
HIGHEST_EXAGGERATION = 1000.0
"""Largest factor on a drawn deflection."""
Mistakes = Iterable[tuple[int, str]]
"""(line of the file, what is wrong in it)."""
MOST_TOLD = 20
"""Most mistakes of one file that are listed."""


def told_together(mistakes: Sequence[str]) -> str:
    """The first `MOST_TOLD` mistakes of a file as one text."""
    more = len(mistakes) - MOST_TOLD
    are = "One more line is wrong" if more == 1 else f"{more} more lines are wrong"
    last = [f"{are}: mend these first."] if more > 0 else []
    return " ".join([*mistakes[:MOST_TOLD], *last])


class LessonError(FlexlabError, ValueError):
    """A file is not a valid lesson; the text lists its mistakes."""

    def __init__(self, file: Path, mistakes: Mistakes):
        told = told_together([f"line {line}: {reason}" for line, reason in sorted(mistakes)])
        super().__init__(f"{file.name} is not a lesson: {told}")


class Chapter(NamedTuple):
    """One chapter of the guide."""

    id: str
    """File name without number and ending, as "the-equations"."""
    title: str
    text: str
    """Markdown without the title, with pictures and tables inserted."""


class Lesson(NamedTuple):
    """One guided lesson: a preset, what to do, what to observe, and the check that it is done."""

    id: str
    title: str
    preset: str
    """The preset to start from."""
    check: str
    """A comparison, or rules (`flexlab.analysis.lesson_checks`)."""
    question: str
    """Markdown: what the lesson is about."""
    guess: str
    """The question whose answer is guessed first; empty for none."""
    options: tuple[str, ...]
    """Answers to choose from."""
    answer: str
    """The right option."""
    steps: str
    """Markdown: a numbered list of what to do."""
    observe: str
    """Markdown: what to see, and why."""
    hint: str = ""
    """Shown while the check does not hold; rules have sentences of their own."""
    exaggeration: float | None = None
    """Factor on the drawn deflection of its runs; None for the preset's."""
    lines: tuple[tuple[str, int], ...] = ()
    """(field, line in the file) of each field of the head and of the check."""

    @property
    def text(self) -> str:
        """The whole lesson as markdown, without its title."""
        options = "\n".join(f"- {option}" for option in self.options)
        guess = (("Guess", f"{self.guess}\n\n{options}"),) if self.options else ()
        parts = (*guess, ("Do", self.steps), ("Observe", self.observe))
        return "\n\n".join([self.question, *(f"#### {title}\n\n{text}" for title, text in parts)])


class LessonProgress(NamedTuple):
    """Somebody's progress in one lesson."""

    lesson: str
    """Its name in the guide's menu."""
    step: int
    """1 to 3."""
    question: str
    """The question whose answer is guessed; empty for none."""
    options: tuple[str, ...]
    answer: str
    """The right option."""
    guess: str
    """The option that was guessed; empty for none."""
    passed: str
    """The check's sentence when it held; empty if it has not yet."""


def begun(lessons: Iterable[LessonProgress]) -> tuple[LessonProgress, ...]:
    """The lessons with a guess or a passed check, as notes keep them: with the right option only if all steps have been seen."""
    met = (one for one in lessons if one.guess or one.passed)
    return tuple(one if one.step == len(STEPS) else one._replace(answer="") for one in met)


def guide_folder() -> Path:
    """The folder of the guide's texts and pictures."""
    return web_assets_folder() / "guide"


@cache
def chapters() -> tuple[Chapter, ...]:
    """All chapters, in reading order."""
    return tuple(_chapter(file) for file in _numbered(guide_folder()))


@cache
def lessons() -> tuple[Lesson, ...]:
    """All lessons, in the order in which they build on one another."""
    return tuple(_lesson(file) for file in _numbered(guide_folder() / "lessons"))


def _numbered(folder: Path) -> list[Path]:
    return sorted(folder.glob("[0-9]*-*.md"), key=lambda file: (int(file.stem.partition("-")[0]), file.name))


def _chapter(file: Path) -> Chapter:
    title, _, text = file.read_text(encoding="utf-8").partition("\n")
    return Chapter(file.stem.partition("-")[2], title.removeprefix("# "), _complete(text.strip(), file.parent))


def read_lesson(
    file: Path, pictures: Path | None = None, further: Callable[[Lesson], Mistakes] = lambda lesson: ()
) -> Lesson:
    """A lesson from its file. Raises `LessonError`, with lines and reasons, if it is not valid.

    `pictures`: the folder of its pictures; None for a lesson without pictures and HTML. `further` finds other mistakes in a
    lesson, some of whose fields may be missing.
    """
    text = file.read_text(encoding="utf-8-sig").replace("\r\n", "\n")
    parts, missing = _parts(file, text)
    head, lines, mistakes = _head(parts["head"])
    mistakes += missing
    if "check" not in head:
        if parts["check"]:
            lines["check"] = text.split("\n").index(CHECK) + 1
        else:
            mistakes.append((2 + len(head), "the head has no check."))
    fields = [parts[name].strip() for name in ("question", "steps", "observe")]
    show = without_html if pictures is None else lambda field: _complete(field, pictures)
    question, steps, observe = map(show, fields)
    guess = parts["guess"]
    options = _OPTION.findall(guess)
    right = [option for mark, option in options if mark == "x"]
    if guess and (len(right) != 1 or len(options) < 2):
        line = text.split("\n").index(GUESS) + 2
        reason = "## Guess needs lines - [ ] with what can be guessed, and one line - [x] with what is right."
        mistakes.append((line, reason))
    factor = head.get("exaggeration")
    exaggeration = float(factor) if re.fullmatch(r"\d+(\.\d+)?", factor or "") else 0.0
    if factor is not None and not 1 <= exaggeration <= HIGHEST_EXAGGERATION:
        allowed = f"a number from 1 to {HIGHEST_EXAGGERATION:g}"
        reason = f"exaggeration = {factor[:40]!r} is not a factor for the drawn deflection: write {allowed}."
        mistakes.append((lines["exaggeration"], reason))
    lesson = Lesson(
        id=file.stem, title=head.get("title", ""), preset=head.get("preset", ""), check=head.get("check") or parts["check"],
        question=question, guess=" ".join(_OPTION.sub("", guess).split()), options=tuple(option for _, option in options),
        answer=right[0] if right else "", steps=steps, observe=observe, hint=head.get("hint", ""),
        exaggeration=exaggeration or None, lines=tuple(lines.items()),
    )  # fmt: skip
    mistakes += further(lesson)
    if mistakes:
        raise LessonError(file, mistakes)
    return lesson


def without_html(text: str) -> str:
    """Markdown in which HTML is shown as text."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def _head(text: str) -> tuple[dict[str, str], dict[str, int], list[tuple[int, str]]]:
    """The fields between the --- lines, the line of each, and the mistakes."""
    head: dict[str, str] = {}
    lines: dict[str, int] = {}
    mistakes: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 2):
        name, _, value = (part.strip() for part in line.partition(":"))
        if name not in FIELDS or name in head or not value:
            mistakes.append((number, f"{line[:60]!r} is not a field: write each of {', '.join(FIELDS)} once."))
        else:
            head[name], lines[name] = value, number
    mistakes += ((2 + len(head), f"the head has no {name}.") for name in NEEDED if name not in head)
    return head, lines, mistakes


def _parts(file: Path, text: str) -> tuple[dict[str, str], list[tuple[int, str]]]:
    """Head, question, guess, steps, observe and check (may be empty), and the mistakes. Raises `LessonError` without a head."""
    lines = text.split("\n")
    if lines[0] != HEAD_LINE:
        raise LessonError(file, [(1, "a lesson begins with a line --- and its head.")])
    if HEAD_LINE not in lines[1:]:
        raise LessonError(file, [(len(lines), "the head does not end: it needs a second line ---.")])
    second, part, following, missing = lines.index(HEAD_LINE, 1), "question", list(PARTS), [DO, OBSERVE]
    found: dict[str, list[str]] = {"head": lines[1:second], "question": [], **{name: [] for name in PARTS.values()}}
    for line in lines[second + 1 :]:
        if line in following:
            part, following = PARTS[line], following[following.index(line) + 1 :]
            missing = [title for title in missing if title != line]
        else:
            found[part].append(line)
    lacks = "there is no line {}: a lesson has ## Do and ## Observe, in this order."
    mistakes = [(len(lines), lacks.format(title)) for title in missing]
    return {name: "\n".join(those) for name, those in found.items()}, mistakes


def _lesson(file: Path) -> Lesson:
    return read_lesson(file, file.parent.parent)._replace(id=file.stem.partition("-")[2])


def _complete(text: str, folder: Path) -> str:
    text = _SYMBOLS.sub(lambda found: symbol_table(found[1].split()), text)
    text = _INDEXED.sub(r"| \1<sub>\2</sub> |", text)
    return _PICTURE.sub(lambda found: _inline(folder / found[2], found[1]), text)


def symbol_table(symbols: list[str]) -> str:
    """A markdown table of symbols with word and unit. Raises KeyError for one that is not in `flexlab.notation`."""
    rows = [notation.lookup(symbol) for symbol in symbols]
    lines = ["| symbol | what it is | unit |", "|---|---|---|"]
    return "\n".join(lines + [f"| {row.symbol} | {row.word} | {row.unit} |" for row in rows])


def _inline(file: Path, alt: str) -> str:
    """A picture as one line of HTML: in markdown, an empty line would end it."""
    picture = re.sub(r">\s+<", "><", file.read_text(encoding="utf-8").strip())
    label = f'<svg role="img" aria-label="{html.escape(alt)}" style="max-width:100%;height:auto" '
    return f'<div style="margin:0.4em 0;overflow-x:auto">{picture.replace("<svg ", label, 1)}</div>'


LOCKED = "The teacher has locked this lab: nothing can be played or changed until they unlock it."


def step_text(step: int) -> str:
    """A step in words."""
    return f"step {step} of {len(STEPS)} ({STEPS[step - 1]})"


@dataclass(frozen=True)
class ClassRules:
    """What a teacher asks of every lab of a class."""

    lesson: str = ""
    """The one lesson that is open, as the guide's menu calls it; empty if each chooses."""
    step: int = len(STEPS)
    """The last step of that lesson that is shown, 1 to 3."""
    locked: bool = False
    """Whether only the teacher can play or change anything."""
    hides_names: bool = False
    """Whether the teacher's page shows numbers instead of names."""

    @property
    def pace(self) -> str:
        """Where the class is, as a sentence; empty if each chooses."""
        return f"{self._place}: open the Guide. The teacher opens the next step." if self.lesson else ""

    @property
    def pace_on_play_screen(self) -> str:
        """Where the class is, as a sentence for the play screen, which has no guide."""
        return (
            f"{self._place}: press More, then open the Guide. The teacher opens the next step." if self.lesson else ""
        )

    @property
    def _place(self) -> str:
        return f"The class is at {step_text(self.step)} of “{self.lesson}”"
