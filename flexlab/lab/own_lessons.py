"""Lessons of a person's own: markdown files in a folder `lessons` where they work, beside their presets.

Like flexlab's own lessons, with a check that is an expression over metrics and signals and a hint:

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
from pathlib import Path
from typing import NamedTuple

from flexlab.analysis.lesson_checks import CHECKS, Verdict
from flexlab.analysis.lesson_expressions import Expression, ExpressionError
from flexlab.errors import FlexlabError
from flexlab.guide import Lesson, LessonError, read_lesson
from flexlab.presets import preset_names
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples

OWN_LESSONS = Path("lessons")
"""Relative to the working directory."""
LARGEST = 200_000
"""Bytes of a lesson's file."""
MOST = 50
"""Lessons that a menu can hold."""


class OwnLesson(NamedTuple):
    """A lesson with the check that its file gives, or what is wrong with the file."""

    name: str
    """Of the file, without ending."""
    lesson: Lesson | None
    expression: Expression | None
    problem: str
    """A sentence with line and reason; empty if all is well."""

    def verdict(self, scenario: Scenario, samples: Samples) -> Verdict:
        """Whether the check holds in a run."""
        assert self.expression is not None
        assert self.lesson is not None
        try:
            done = len(samples) > 1 and self.expression.holds(scenario, samples)
        except (FlexlabError, ArithmeticError, IndexError, TypeError, ValueError) as error:
            return Verdict(False, f"The check cannot be worked out in this run ({error}). {self.lesson.hint}".strip())
        return Verdict(done, "The check holds ✓" if done else self.lesson.hint or "Not yet.")


def own_lessons(folder: Path = OWN_LESSONS) -> list[OwnLesson]:
    """All lessons of a folder by name, bad ones with what is wrong."""
    return [_read(file) for file in sorted(folder.glob("*.md"))[:MOST]]


def lesson_files(folder: Path = OWN_LESSONS) -> dict[str, int]:
    """Name → when it was saved, ns, of each file: where this is another one there is something to read."""
    found: dict[str, int] = {}
    for file in folder.glob("*.md"):
        with contextlib.suppress(OSError):  # It vanished meanwhile.
            found[file.name] = file.stat().st_mtime_ns
    return found


def _read(file: Path) -> OwnLesson:
    try:
        if file.stat().st_size > LARGEST:
            raise LessonError(f"{file.name}: over {LARGEST} bytes: that is no lesson.")
        lesson = read_lesson(file)
        if lesson.preset not in preset_names():
            raise LessonError(
                f"{file.name} is not a lesson: line {lesson.line_of('preset')}: there is no preset {lesson.preset[:40]!r}."
            )
        if lesson.check in CHECKS:
            raise LessonError(
                f"{file.name} is not a lesson: line {lesson.line_of('check')}: give an expression, such as t > 1."
            )
        try:
            return OwnLesson(file.stem, lesson, Expression(lesson.check), "")
        except ExpressionError as error:
            raise LessonError(f"{file.name} is not a lesson: line {lesson.line_of('check')}: {error}") from None
    except (LessonError, OSError, UnicodeDecodeError) as error:
        reason = str(error) if isinstance(error, LessonError) else f"{file.name}: it cannot be read ({error})."
        return OwnLesson(file.stem, None, None, reason)
