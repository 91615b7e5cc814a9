"""The guide in the lab: chapters to read, and lessons with what to do, what to observe and a check of its own."""

import viser

from flexlab.analysis.lesson_checks import SECONDS, check_lesson
from flexlab.guide import Chapter, Lesson, chapters, lessons
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.text import escaped
from flexlab.presets import load_preset
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot

EVERY = 10
"""Panel updates per check (1 Hz): a check reads the whole run."""
NOTHING = "Choose what to read"


class Guide:
    """Menu, text and check, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, runner: Runner):
        self._lab_state, self._runner = lab_state, runner
        self._count = 0
        self._pages: dict[str, Chapter | Lesson] = {chapter.title: chapter for chapter in chapters()}
        self._pages |= {f"Lesson {k + 1}: {lesson.title}": lesson for k, lesson in enumerate(lessons())}
        first = next(iter(self._pages))
        self._menu = gui.add_dropdown("Read", tuple(self._pages), initial_value=first)
        self._start = gui.add_button("Load its preset", color="gray", visible=False, hint="Starts a new run")
        self._verdict = gui.add_html("", visible=False)
        self._text = gui.add_markdown("")
        self._start.on_click(handler(lab_state, lambda _: self._load()))
        self._menu.on_update(handler(lab_state, lambda _: self._turn_to(self._menu.value)))
        self._turn_to(first)

    def update(self, snapshot: Snapshot) -> None:
        """Check the open lesson."""
        self._count += 1
        page = self._pages.get(self._menu.value)
        if isinstance(page, Lesson) and self._count % EVERY == 0:
            self._check(page, snapshot)

    def _turn_to(self, title: str) -> None:
        page = self._pages[title]
        lesson = page if isinstance(page, Lesson) else None
        self._start.visible = self._verdict.visible = lesson is not None
        self._text.content = page.text if isinstance(page, Chapter) else lesson_text(page)
        if lesson is not None:
            self._start.label = f"Load {lesson.preset}"
            self._check(lesson, self._lab_state.snapshot)

    def _load(self) -> None:
        page = self._pages[self._menu.value]
        if isinstance(page, Lesson):
            self._lab_state.load(load_preset(page.preset), page.preset)

    def _check(self, lesson: Lesson, snapshot: Snapshot) -> None:
        samples = self._runner.recent(SECONDS)
        verdict = check_lesson(lesson.check, snapshot.scenario, samples, snapshot.events)
        look = "fl-done" if verdict.done else "fl-info"
        words = "Done" if verdict.done else "Your run"
        self._verdict.content = (
            f'<div class="fl"><div class="fl-box {look}"><b>{words}.</b> {escaped(verdict.sentence)}</div></div>'
        )


def lesson_text(lesson: Lesson) -> str:
    """A lesson as markdown."""
    return f"{lesson.question}\n\n#### Do\n\n{lesson.steps}\n\n#### Observe\n\n{lesson.observe}"
