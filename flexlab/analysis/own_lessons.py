"""A person's own lessons: markdown files in the folder `lessons` of the working directory.

They are written like flexlab's lessons, with a hint, and a check that is an expression over metrics and signals:

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
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from flexlab.analysis.lesson_checks import read_check
from flexlab.analysis.lesson_expressions import ExpressionError
from flexlab.guide import Lesson, LessonError, lessons, read_lesson
from flexlab.presets import preset_names
from flexlab.text import writable

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


def lesson_files() -> dict[str, int]:
    """Name → modification time, ns, of each file: a difference means that there is something to read."""
    found: dict[str, int] = {}
    for file in OWN_LESSONS.glob("*.md"):
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
        return _unread(file, f"it cannot be read ({getattr(error, 'strerror', None) or error}).")


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
