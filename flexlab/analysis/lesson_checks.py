"""The checks of lessons, which are rules in a lesson's file, and a person's own lessons. The first rule that holds counts.

    period_bend = largest(quasi_static_deflection, t - period, t)
    if undisturbed < period: Let one period of the path go by.
    done if period_bend > 1e-3: The motion bends the beam by {period_bend:length} ✓
    else: Now set Bending stiffness EI to 10.

A name may also stand for a text in quotes. Braces hold an expression (`lesson_expressions`) and a format: one of Python's, or
`length`, in mm or µm. A line that begins with a space continues the line before. All numbers in a sentence are measured or
computed from this run.

A person's own lessons are markdown files in the folder `lessons` of the working directory, written like flexlab's, with a hint,
and a check that may also be a single expression:

    ---
    title: Stiffer
    preset: paper
    check: scenario.payload.bending_stiffness > 500 and t > 1
    hint: Move the slider of EI to the right.
    ---
    Does the beam ring less when it is stiffer?

    ## Guess
    What happens to the ring?

    - [x] it gets faster and smaller
    - [ ] nothing

    ## Do
    1. Load the preset `paper` and set EI to 600.

    ## Observe
    The frequency grows with the square root of EI.
"""

import contextlib
import re
from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

from flexlab.analysis.lesson_expressions import ExpressionError, Value, expression
from flexlab.analysis.lesson_measures import VALUES, Look, length
from flexlab.analysis.metrics import METRICS
from flexlab.errors import FlexlabError
from flexlab.guide import Lesson, LessonError, lessons, read_lesson, told_together
from flexlab.presets import preset_names
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event
from flexlab.text import writable

_RULE = re.compile(r"(done|else|(?:done )?if (.+?)): (.+)")
_NAME = re.compile(r"([a-z]\w*) = (?:\"(.+)\"|(.+))")
_BRACES = re.compile(r"\{([^{}]+?)(?::(length|g|\.\d[efg]))?\}")


class Verdict(NamedTuple):
    """The result of a check: whether the lesson is done, and a sentence with numbers or the next step."""

    done: bool
    sentence: str


def _sentence(text: str, known: Sequence[str]) -> Value:
    """The text with its braces filled in from a run. Raises `ExpressionError` for braces without an expression."""
    if "{" in _BRACES.sub("", text):
        raise ExpressionError(f"{text[:60]!r} holds no value: write as in {{t:.2f}}, or {{largest(vibration):length}}.")
    values = {found[1]: expression(found[1], known) for found in _BRACES.finditer(text)}

    def shown(run: Look, found: re.Match[str]) -> str:
        value = values[found[1]](run)
        return length(value) if found[2] == "length" else format(value, found[2] or "")

    return lambda run: _BRACES.sub(partial(shown, run), text)


class _Rule(NamedTuple):
    condition: Value | None
    """None: the rule always holds."""
    done: bool
    sentence: Value


NOTHING = expression("0")


class Check:
    """The check of one lesson."""

    def __init__(self, lesson: Lesson):
        """Read the rules. Raises `ExpressionError`, which names all lines that are not rules."""
        self._hint = lesson.hint
        self._named: dict[str, Value] = {}
        self._rules: list[_Rule] = []
        lines = [line for line in re.sub(r"\n +", " ", lesson.check).splitlines() if line.strip()]
        if len(lines) == 1:
            self._rules.append(_Rule(expression(lesson.check, truth=True), True, lambda _: "The check holds ✓"))
            self._rules.append(_Rule(None, False, lambda _: lesson.hint or "Not yet."))
        else:
            mistakes = [mistake for line in lines if (mistake := self._read(line))]
            if not re.match("(done|else) *:", lines[-1] if lines else ""):
                mistakes.append("the last rule must be done: or else: and what to say where no other holds.")
            if mistakes:
                raise ExpressionError(told_together(mistakes))

    def _read(self, line: str) -> str:
        """Read a line with a rule or a name, and return a sentence on its mistake, or "" if there is none."""
        known = list(self._named)
        named, rule = _NAME.fullmatch(line), _RULE.fullmatch(line)
        try:
            if named:
                name, text, given = named.groups()
                # A lesson's name may hide that of a value, but its definition cannot read the value that it hides.
                reads_itself = name in (*VALUES, *METRICS) and re.search(rf"\b{name}\b", text or given)
                if name in known or reads_itself:
                    return f"{line[:60]!r} gives a second meaning to a name: choose another one."
                self._named[name] = NOTHING  # Later lines may use the name even if this line is wrong.
                self._named[name] = _sentence(text, known) if text else expression(given, known)
            elif rule:
                kind, condition, sentence = rule.groups()
                when = expression(condition, known, truth=True) if condition else None
                self._rules.append(_Rule(when, kind.startswith("done"), _sentence(sentence, known)))
            else:
                return f"{line[:60]!r} is not a rule: write name = …, if …: sentence, done if …: sentence, or else: sentence."
        except ExpressionError as error:
            return str(error)
        return ""

    def verdict(self, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
        """The verdict on a run from its newest `SECONDS` s of samples and all its events. Never raises."""
        if len(samples) < 2:
            return Verdict(False, "Press play: there is nothing to measure yet.")
        run = Look(scenario, samples, events, self._named)
        try:
            rule = next(rule for rule in self._rules if rule.condition is None or rule.condition(run))
            return Verdict(rule.done, rule.sentence(run))
        except (ExpressionError, ArithmeticError, IndexError, RecursionError, TypeError, ValueError) as error:
            return Verdict(False, f"The check cannot be worked out in this run ({error}). {self._hint}".strip())
        except FlexlabError as error:  # A measure of the closed loop does not exist for this scenario.
            return Verdict(False, str(error))


@cache
def read_check(lesson: Lesson) -> Check:
    """The check in a lesson's file. Raises `ExpressionError`."""
    return Check(lesson)


def check_lesson(lesson: str, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
    """The verdict of one of flexlab's own lessons, by its id. Raises KeyError for an unknown one."""
    return read_check({each.id: each for each in lessons()}[lesson]).verdict(scenario, samples, events)


OWN_LESSONS = Path("lessons")
"""Relative to the working directory."""
LARGEST = 200_000
"""Largest size of a lesson's file, bytes."""
MOST = 50
"""Largest number of lessons in a menu."""
OWN = "Own lesson: "
"""Prefix of a person's own lessons in the guide's menu."""


class OwnLesson(NamedTuple):
    """A lesson, or the problem with its file."""

    name: str
    """Name of the file, without its ending."""
    lesson: Lesson | None
    problem: str
    """A sentence with line and reason, or ""."""


def own_lessons(folder: Path = OWN_LESSONS) -> list[OwnLesson]:
    """The first `MOST` lessons of a folder, sorted by name; one that cannot be read, or is one too many, has a `problem`."""
    files = sorted(folder.glob("*.md"))
    found = [_read(file) for file in files[:MOST]]
    if len(files) > MOST:
        told = (
            f"the menu holds at most {MOST} lessons, and leaves out this one and those after it by name: remove some."
        )
        found.append(_unread(files[MOST], told))
    return found


def lesson_menu(own: Sequence[OwnLesson]) -> dict[str, Lesson]:
    """All lessons that can be read, flexlab's and a person's own, by their names in the guide's menu."""
    found = {f"Lesson {number}: {lesson.title}": lesson for number, lesson in enumerate(lessons(), 1)}
    titles = [mine.lesson.title for mine in own if mine.lesson is not None]
    for name, lesson, _ in own:
        if lesson is not None:  # Of two with the same title, the menu would have one only.
            found[f"{OWN}{lesson.title}{f' ({name})' if titles.count(lesson.title) > 1 else ''}"] = lesson
    return found


def short_name(lesson: str) -> str:
    """The short name of a lesson in that menu: "Lesson 3", or the title of a person's own."""
    return lesson.removeprefix(OWN) if lesson.startswith(OWN) else lesson.partition(":")[0]


def lesson_files(folder: Path = OWN_LESSONS) -> dict[str, int]:
    """Name → modification time, ns, of each file: a difference means that there is something to read."""
    found: dict[str, int] = {}
    for file in folder.glob("*.md"):
        with contextlib.suppress(OSError):  # It vanished meanwhile.
            found[file.name] = file.stat().st_mtime_ns
    return found


def _read(file: Path) -> OwnLesson:
    try:
        if not file.is_file():  # A pipe would hang.
            raise LessonError(file, [(1, "it is not an ordinary file.")])
        if file.stat().st_size > LARGEST:
            raise LessonError(file, [(1, f"over {LARGEST} bytes are no lesson.")])
        return OwnLesson(writable(file.stem), read_lesson(file, further=_mistakes), "")
    except (LessonError, OSError, UnicodeDecodeError) as error:
        if isinstance(error, LessonError):
            return OwnLesson(writable(file.stem), None, writable(str(error)))
        return _unread(file, f"it cannot be read ({error}).")


def _unread(file: Path, why: str) -> OwnLesson:
    return OwnLesson(writable(file.stem), None, writable(f"{file.name}: {why}"))


def _mistakes(lesson: Lesson) -> Iterator[tuple[int, str]]:
    lines = dict(lesson.lines)
    if "preset" in lines and lesson.preset not in preset_names():
        yield lines["preset"], f"there is no preset {lesson.preset[:40]!r}."
    if "check" in lines:
        try:
            read_check(lesson)
        except ExpressionError as error:
            yield lines["check"], str(error)


def lesson_mistakes(folder: Path = OWN_LESSONS) -> list[str]:
    """A sentence with line and reason for each lesson of a folder that cannot be read."""
    return [own.problem for own in own_lessons(folder) if own.problem]
