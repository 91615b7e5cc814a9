"""The guide in the lab: chapters to read, and lessons: what do you guess, what to do, a check of its own, then the answer."""

import viser

from flexlab.analysis.lesson_checks import SECONDS, check_lesson
from flexlab.guide import Chapter, Lesson, chapters, lessons, without_html
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.own_lessons import lesson_files, own_lessons
from flexlab.lab.panel.number_control import put
from flexlab.lab.panel.text import escaped
from flexlab.lab.view_settings import fitting_exaggeration
from flexlab.plain_text import with_units
from flexlab.presets import load_preset
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot

EVERY = 10
"""Panel updates per check (1 Hz): a check reads the whole run."""
OPEN = "Choose one"


class Guide:
    """Menu, text, guess and check, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, runner: Runner):
        self._lab_state, self._runner = lab_state, runner
        self._count = 0
        self._guesses: dict[str, str] = {}
        self._unfolded: set[str] = set()
        self._done: dict[str, str] = {}
        self._files = lesson_files()
        self._collect()
        first = next(iter(self._pages))
        gui.add_html('<div class="fl-guide"></div>')  # By which the page knows whether the guide is open.
        self._menu = gui.add_dropdown("Read", tuple(self._pages), initial_value=first)
        self._text = gui.add_markdown("")
        self._guess_question = gui.add_html("", visible=False)
        self._guess = gui.add_dropdown("What do you guess?", (OPEN,), initial_value=OPEN, visible=False)
        self._steps = gui.add_markdown("", visible=False)
        self._start = gui.add_button("Load its preset", color="gray", visible=False, hint="Starts a new run")
        self._verdict = gui.add_html("", visible=False)
        self._unfold = gui.add_button("Show the answer", color="gray", visible=False, hint="Before the check is done")
        self._answer = gui.add_markdown("", visible=False)
        self._start.on_click(handler(lab_state, lambda _: self._load()))
        self._unfold.on_click(handler(lab_state, lambda _: self._show_answer()))
        self._guess.on_update(handler(lab_state, lambda _: self._take_guess(self._guess.value)))
        self._menu.on_update(handler(lab_state, lambda _: self._turn_to(self._menu.value)))
        self._turn_to(first)

    def _collect(self) -> None:
        """Know all chapters and lessons that there are now."""
        self._pages: dict[str, Chapter | Lesson] = {chapter.title: chapter for chapter in chapters()}
        self._pages |= {f"Lesson {k + 1}: {lesson.title}": lesson for k, lesson in enumerate(lessons())}
        mine = own_lessons()
        self._own = {own.lesson.id: own for own in mine if own.lesson is not None}
        for own in mine:
            title = own.lesson.title if own.lesson is not None else f"{own.name} (cannot be read)"
            # Own texts come from files of whoever started the lab; still they get no HTML into the page.
            self._pages[f"Own lesson: {title}"] = own.lesson or Chapter(own.name, title, without_html(own.problem))

    def _follow_files(self) -> None:
        """Take up lessons of one's own that are new or were saved; the page that is open stays open."""
        files = lesson_files()
        if files == self._files:
            return
        self._files, title = files, self._menu.value
        before = self._pages.get(title)
        self._collect()
        self._menu.options = tuple(self._pages)
        if title not in self._pages:
            self._menu.value = next(iter(self._pages))
        if self._pages[self._menu.value] != before:
            self._turn_to(self._menu.value)

    def update(self, snapshot: Snapshot) -> None:
        """Check the open lesson."""
        self._count += 1
        if self._count % EVERY == 0:
            self._follow_files()
        page = self._pages.get(self._menu.value)
        if isinstance(page, Lesson) and self._count % EVERY == 0:
            self._check(page, snapshot)

    def _turn_to(self, title: str) -> None:
        page = self._pages[title]
        self._lab_state.lesson = ""
        lesson = page if isinstance(page, Lesson) else None
        self._lab_state.hold_exaggeration(None if lesson is None else _factor(lesson))
        for widget in (self._guess_question, self._guess, self._steps, self._start, self._verdict):
            put(widget, visible=lesson is not None)
        put(self._text, content=page.question if isinstance(page, Lesson) else page.text)
        if lesson is None:
            put(self._unfold, visible=False)
            put(self._answer, visible=False)
            return
        for widget in (self._guess_question, self._guess):
            put(widget, visible=bool(lesson.options))
        put(self._guess_question, content=f'<div class="fl">{escaped(lesson.guess)}</div>')
        self._guess.options = (OPEN, *lesson.options)
        self._guess.value = self._guesses.get(lesson.id, OPEN)
        put(self._steps, content=f"#### Do\n\n{lesson.steps}")
        self._start.label = f"Load {lesson.preset}"
        self._check(lesson, self._lab_state.snapshot)

    def _lesson(self) -> Lesson | None:
        page = self._pages[self._menu.value]
        return page if isinstance(page, Lesson) else None

    def _take_guess(self, option: str) -> None:
        lesson = self._lesson()
        if lesson is not None and option in lesson.options:
            self._guesses[lesson.id] = option
            self._fold(lesson)

    def _show_answer(self) -> None:
        lesson = self._lesson()
        if lesson is not None:
            self._unfolded.add(lesson.id)
            self._fold(lesson)

    def _fold(self, lesson: Lesson) -> None:
        """The answer stays folded until the check is done, or somebody asks for it."""
        unfolded = lesson.id in self._unfolded
        put(self._unfold, visible=not unfolded)
        put(self._answer, visible=unfolded, content=answer_text(lesson, self._guesses.get(lesson.id, "")))

    def _load(self) -> None:
        lesson = self._lesson()
        if lesson is not None:
            self._done.pop(lesson.id, None)
            self._lab_state.load(load_preset(lesson.preset), lesson.preset)

    def _check(self, lesson: Lesson, snapshot: Snapshot) -> None:
        samples = self._runner.recent(SECONDS)
        own = self._own.get(lesson.id)
        if own is not None and own.lesson is lesson:
            verdict = own.verdict(snapshot.scenario, samples)
        else:
            verdict = check_lesson(lesson.check, snapshot.scenario, samples, snapshot.events)
        if verdict.done:
            self._unfolded.add(lesson.id)
            self._done[lesson.id] = verdict.sentence
        # What was done stays done, whatever is tried afterwards: some lessons end by setting things back.
        done = self._done.get(lesson.id)
        look, words, sentence = ("fl-info", "Your run", verdict.sentence) if done is None else ("fl-done", "Done", done)
        progress = "done" if done is not None else "guessed" if lesson.id in self._guesses else "begun"
        self._lab_state.lesson = f"{lesson.title}: {progress}"
        self._verdict.content = (
            f'<div class="fl"><div class="fl-box {look}"><b>{words}.</b> {escaped(with_units(sentence))}</div></div>'
        )
        self._fold(lesson)


def _factor(lesson: Lesson) -> float:
    """By which all runs of a lesson are drawn: else a soft beam could look straighter than a stiff one."""
    return lesson.exaggeration or fitting_exaggeration(load_preset(lesson.preset))


def answer_text(lesson: Lesson, guess: str) -> str:
    """What there is to observe, and what became of the guess, as markdown."""
    if not lesson.options:
        return f"#### Observe\n\n{lesson.observe}"
    if not guess:
        word = f"It is: {lesson.answer}."
    elif guess == lesson.answer:
        word = f"You guessed it: {guess}."
    else:
        word = f"You guessed: {guess}. It is: {lesson.answer}."
    return f"#### Observe\n\n**{without_html(word)}**\n\n{lesson.observe}"
