"""Lessons done in a real browser as they are written: each check turns green, each number of the text is seen on the page.

Two lessons by default; `pytest tests/lab/test_lessons_in_browser.py --all-lessons` does all.
"""

import pytest
from lab_page import LabPage
from lesson_steps import do_lesson

from flexlab.guide import lessons

USUAL = (1, 7)
"""Lessons that are always tested, by number: one that watches runs, and one with folders, menus and switches."""
VARYING = (3, 8)
"""Lessons with numbers that the page may not show exactly: chatter grows while one waits, a delay follows from a setting."""
LESSONS = list(enumerate(lessons(), 1))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "number" in metafunc.fixturenames:
        every = metafunc.config.getoption("all_lessons")
        metafunc.parametrize("number", [number for number, _ in LESSONS if every or number in USUAL])


def test_a_lesson_can_be_done_as_it_is_written(page: LabPage, number: int):
    lesson = dict(LESSONS)[number]
    seen = do_lesson(page, number, lesson, print)
    assert number in VARYING or not seen.missing(lesson.observe)
    assert not page.errors
