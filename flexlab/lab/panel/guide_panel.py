"""The guide in the lab: chapters, and lessons with a guess, steps, a check and the answer."""

from flexlab.analysis.lesson_checks import read_check
from flexlab.analysis.lesson_measures import SECONDS
from flexlab.analysis.own_lessons import OWN, lesson_files, lesson_menu, own_lessons
from flexlab.errors import LabError
from flexlab.guide import STEPS, Chapter, Lesson, LessonProgress, chapters, step_text, without_html
from flexlab.lab.widgets import Menu, Widgets, put
from flexlab.presets import load_preset
from flexlab.sim.snapshot import Snapshot
from flexlab.text import escaped, with_units
from flexlab.views import fitting_exaggeration

OPEN = "Choose one"


class Guide:
    """Menu, text, guess and check, made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = widgets.lab_state
        self._guesses: dict[str, str] = {}
        self._unfolded: set[str] = set()
        self._done: dict[str, str] = {}
        self._files = lesson_files()
        self._pace = widgets.lab_state.rules.pace
        self._collect()
        self._shown = self._resumed()
        widgets.gui.add_html('<div class="fl-guide"></div>')  # This tells the page whether the guide is open.
        self._menu = Menu(widgets, "Read", lambda: self._pages, lambda: self._shown, self._choose)
        self._text = widgets.gui.add_markdown("")
        self._guess_question = widgets.gui.add_html("", visible=False)
        self._guess = Menu(widgets, "What do you guess?", self._guessable, self._guessed, self._take_guess)
        self._steps = widgets.gui.add_markdown("", visible=False)
        self._start = widgets.button("Load its preset", lambda _: self._load(), visible=False, hint="Starts a new run")
        self._verdict = widgets.gui.add_html("", visible=False)
        hint = "Before the check is done"
        self._unfold = widgets.button("Show the answer", lambda _: self._show_answer(), visible=False, hint=hint)
        self._answer = widgets.gui.add_markdown("", visible=False)
        self._rest = widgets.gui.add_html("", visible=False)
        self._turn_to(self._shown)

    def _collect(self) -> None:
        """Collect all present chapters and lessons."""
        self._pages: dict[str, Chapter | Lesson] = {chapter.title: chapter for chapter in chapters()}
        mine = own_lessons()
        self._pages |= lesson_menu(mine)
        for own in mine:
            if own.lesson is None:
                title = f"{own.name} (cannot be read)"
                # Own lessons come from files of whoever started the lab; even so, they bring no HTML into the page.
                self._pages[f"{OWN}{title}"] = Chapter(own.name, title, without_html(own.problem))

    def _resumed(self) -> str:
        """Take up the progress of the same person's lab before, and return the page to open."""
        shown = next(iter(self._pages))
        for title, page in self._pages.items():
            if not isinstance(page, Lesson):
                continue
            if self._lab_state.lesson.startswith(f"{page.title}: "):
                shown = title
            progress = self._lab_state.lessons.get(title)
            if progress is None:
                continue
            if progress.guess in page.options:
                self._guesses[page.id] = progress.guess
            if progress.step == len(STEPS):
                self._unfolded.add(page.id)
            if progress.passed:
                self._done[page.id] = progress.passed
        return shown

    def _follow_files(self) -> None:
        """Take up own lessons that are new or were saved; the open page stays open."""
        files = lesson_files()
        if files == self._files:
            return
        self._files, before = files, self._pages[self._shown]
        self._collect()
        title = self._shown if self._shown in self._pages else next(iter(self._pages))
        if self._pages[title] != before:
            self._turn_to(title)
        self._menu.settle()

    def update(self, snapshot: Snapshot) -> None:
        """Follow the files and the teacher, and check the open lesson; call once a second, as the check reads the whole run."""
        self._follow_files()
        rules = self._lab_state.rules
        if rules.pace != self._pace:  # Go to the step of the class, or show all steps again.
            self._pace = rules.pace
            self._turn_to(rules.lesson if rules.lesson in self._pages else self._shown)
        lesson = self._lesson()
        if lesson is not None:
            self._check(lesson, snapshot)

    def _choose(self, title: str) -> None:
        rules = self._lab_state.rules
        if rules.lesson in self._pages and title != rules.lesson and isinstance(self._pages[title], Lesson):
            raise LabError(rules.pace)
        self._turn_to(title)

    @property
    def _last_step(self) -> int:
        """The last step of the shown page that the teacher has opened."""
        rules = self._lab_state.rules
        return rules.step if self._shown == rules.lesson else len(STEPS)

    def _turn_to(self, title: str) -> None:
        page, self._shown = self._pages[title], title
        self._menu.settle()
        self._lab_state.lesson, lesson = "", self._lesson()
        self._lab_state.hold_exaggeration(None if lesson is None else _factor(lesson))
        for widget in (self._guess_question, self._guess.widget, self._steps, self._start, self._verdict):
            put(widget, visible=lesson is not None and self._last_step > 1)
        why = f"The class is at {step_text(self._last_step)}. The teacher opens the next step."
        put(self._rest, visible=self._last_step < len(STEPS), content=f'<div class="fl fl-dim">{why}</div>')
        put(self._text, content=with_units(page.question if isinstance(page, Lesson) else page.text))
        if lesson is None:
            put(self._unfold, visible=False)
            put(self._answer, visible=False)
            return
        for widget in (self._guess_question, self._guess.widget):
            put(widget, visible=bool(lesson.options))
        put(self._guess_question, content=f'<div class="fl">{escaped(lesson.guess)}</div>')
        self._guess.settle()
        put(self._steps, content=with_units(f"#### Do\n\n{lesson.steps}"))
        self._start.label = f"Load {lesson.preset}"
        self._check(lesson, self._lab_state.snapshot)

    def _lesson(self) -> Lesson | None:
        page = self._pages[self._shown]
        return page if isinstance(page, Lesson) else None

    def _guessable(self) -> tuple[str, ...]:
        lesson = self._lesson()
        return (OPEN, *(() if lesson is None else lesson.options))

    def _guessed(self) -> str:
        lesson = self._lesson()
        return OPEN if lesson is None else self._guesses.get(lesson.id, OPEN)

    def _take_guess(self, option: str) -> None:
        lesson = self._lesson()
        if lesson is None or option == self._guessed():
            return
        if lesson.id in self._unfolded:
            raise LabError("The answer is already shown: your earlier guess stands.")
        if option in lesson.options:
            self._guesses[lesson.id] = option
            self._fold(lesson)

    def _show_answer(self) -> None:
        lesson = self._lesson()
        if lesson is not None:
            self._unfolded.add(lesson.id)
            self._fold(lesson)

    def _fold(self, lesson: Lesson) -> None:
        """Show the answer if the check is done or somebody asked for it, and fold it otherwise."""
        may_see = self._last_step == len(STEPS)
        unfolded = lesson.id in self._unfolded and may_see
        put(self._unfold, visible=not unfolded and may_see)
        told = answer_text(lesson, self._guesses.get(lesson.id, ""))
        put(self._answer, visible=unfolded, content=with_units(told))

    def _load(self) -> None:
        lesson = self._lesson()
        if lesson is not None:
            self._done.pop(lesson.id, None)
            self._lab_state.load(load_preset(lesson.preset), lesson.preset)

    def _check(self, lesson: Lesson, snapshot: Snapshot) -> None:
        verdict = read_check(lesson).verdict(snapshot.scenario, self._lab_state.runner.recent(SECONDS), snapshot.events)
        if verdict.done:
            self._unfolded.add(lesson.id)
            self._done[lesson.id] = verdict.sentence
        # A check that was met stays met: some lessons end by setting things back.
        done = self._done.get(lesson.id)
        look, words, sentence = ("fl-info", "Your run", verdict.sentence) if done is None else ("fl-done", "Done", done)
        self._tell(lesson, done or "")
        self._verdict.content = (
            f'<div class="fl"><div class="fl-box {look}"><b>{words}.</b> {escaped(with_units(sentence))}</div></div>'
        )
        self._fold(lesson)

    def _tell(self, lesson: Lesson, done: str) -> None:
        """Report this lab's progress to the teacher."""
        guess, title = self._guesses.get(lesson.id, ""), self._shown
        step = 3 if lesson.id in self._unfolded else 2 if guess or not lesson.options else 1
        step = min(step, self._last_step)
        before = self._lab_state.lessons.get(title)
        passed = done or (before.passed if before is not None else "")
        now = LessonProgress(title, step, lesson.guess, lesson.options, lesson.answer, guess, passed)
        self._lab_state.lesson = f"{lesson.title}: {'done' if done else step_text(step)}"
        self._lab_state.lessons = self._lab_state.lessons | {title: now}


def _factor(lesson: Lesson) -> float:
    """One exaggeration for all runs of a lesson: otherwise a soft beam could look straighter than a stiff one."""
    return lesson.exaggeration or fitting_exaggeration(load_preset(lesson.preset))


def answer_text(lesson: Lesson, guess: str) -> str:
    """The observation, and whether the guess was right, as markdown."""
    if not lesson.options:
        return f"#### Observe\n\n{lesson.observe}"
    if not guess:
        word = f"It is: {lesson.answer}."
    elif guess == lesson.answer:
        word = f"You guessed it: {guess}."
    else:
        word = f"You guessed: {guess}. It is: {lesson.answer}."
    return f"#### Observe\n\n**{without_html(word)}**\n\n{lesson.observe}"
