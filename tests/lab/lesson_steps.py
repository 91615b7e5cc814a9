"""Do a lesson as it is written: follow its steps, and find each control by the name that the text uses."""

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from lab_page import PATIENCE, LabPage, wait_until
from playwright.sync_api import Locator

from flexlab.guide import Lesson
from flexlab.scenario.field_text import in_words

WORDS = {"a": 1.0, "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0}
NAME = r"\*\*([^*]+)\*\*"
COMMANDS = re.compile(r"\b(set|load|press|wait|open|give|choose|turn|go on|run)\b", re.IGNORECASE)
"""Words with which a text asks for an action: none may be left over once the actions are recognised."""
FASTEST = "4 ×"
"""Speed of the simulation where the text names none."""
LOOKED_AT = """() => [document.body.innerText, Object.values(window.__viserTestpoints.uplots)
  .filter(({ chart }) => chart.root.offsetParent !== null)
  .flatMap(({ chart }) => chart.series.slice(1).map((series, k) => {
    const [times, values] = [chart.data[0], chart.data[k + 1]];
    const end = times[times.length - 1];
    const peak = (of) => Math.max(0, ...of.filter(Number.isFinite).map(Math.abs));
    const begun = times.findIndex((_, i) => Number.isFinite(values[i]));
    const part = (first, last) => peak(Array.from(values).filter((_, i) => times[i] >= first && times[i] <= last));
    return { label: series.label, peaks: [peak(Array.from(values)), part(end - 1, end), part(times[begun], times[begun] + 0.1)] };
  }))]"""
"""All words on the page, and three peaks of each curve on the screen: of all that is shown, of the newest second, and of the
first tenth of a second."""
SMALL = {"mm": 1e-3, "µm": 1e-6, "mrad": 1e-3, "ms": 1e-3, "kHz": 1e3, "mJ": 1e-3}
BASE = {"mm": "m", "µm": "m", "mrad": "rad", "ms": "s", "kHz": "Hz", "mJ": "J"}
UNITS = "mm|µm|mrad|kHz|Hz|N·m/s|N·m|N/m|N|1/s|ms|m/s|s|%|kg|m"
NUMBER = re.compile(rf"(?<![\w.,])([+−-]?\d+(?:\.\d+)?(?:e-?\d+)?)\s(?:×\s)?({UNITS})(?![\w·/²])")


class Deed(NamedTuple):
    """One action that a text asks for: its words, and a function that performs it on a page."""

    words: str
    do: Callable[[LabPage], None]


class Seen:
    """What the page showed while a lesson was done: numbers with units, in texts and as peaks of curves."""

    def __init__(self) -> None:
        self._numbers: set[tuple[float, str]] = set()

    def look(self, page: LabPage) -> None:
        """Add the numbers that the page shows now."""
        text, curves = page.page.evaluate(LOOKED_AT)
        self._numbers |= set(numbers(text))
        for curve in curves:
            unit = re.search(r"\((\S+)\)$", curve["label"])
            if unit is not None:
                self._numbers |= {_base(peak, unit[1]) for peak in curve["peaks"]}

    def missing(self, text: str) -> list[str]:
        """The numbers of a text that the page never showed, to the digits that the text gives."""
        return [found[0] for found in NUMBER.finditer(_plain(text)) if not self._has(found[1], found[2])]

    def _has(self, digits: str, unit: str) -> bool:
        value, kind = _base(float(digits.replace("−", "-")), unit)
        last = 10.0 ** -len(digits.partition(".")[2]) * SMALL.get(unit, 1.0)
        return any(kind == other and abs(abs(number) - abs(value)) <= 0.51 * last for number, other in self._numbers)


def numbers(text: str) -> Iterator[tuple[float, str]]:
    """The numbers with units in a text, in base units."""
    for found in NUMBER.finditer(_plain(text)):
        yield _base(float(found[1].replace("−", "-")), found[2])


def deeds(step: str) -> list[Deed]:
    """The actions that a step asks for, in order. Fails if part of the step asks for an unknown action."""
    text, found, taken = _plain(step), [], [False] * len(_plain(step))
    for pattern, meaning in GRAMMAR:
        for match in re.finditer(pattern, text):
            if any(taken[match.start() : match.end()]):
                continue
            taken[match.start() : match.end()] = [True] * (match.end() - match.start())
            found.append((match.start(), Deed(match[0], meaning(*match.groups()))))
    rest = "".join(" " if used else letter for letter, used in zip(text, taken, strict=True))
    assert not COMMANDS.search(rest), f"what is to be done here? {rest!r}"
    return [deed for _, deed in sorted(found, key=lambda each: each[0])]


def do_lesson(page: LabPage, number: int, lesson: Lesson, say: Callable[[str], None] = lambda _: None) -> Seen:
    """Do a whole lesson and return what was seen. Fails if a control is missing, or the check is not met at the end."""
    seen = Seen()
    page.open_tab("Guide")
    page.choose("Read", f"Lesson {number}: {lesson.title}")
    if lesson.answer:
        page.choose("What do you guess?", lesson.answer)
    page.choose("Speed", FASTEST)
    for step in re.split(r"^\d+\. ", lesson.steps, flags=re.MULTILINE)[1:]:
        for deed in deeds(step):
            say(deed.words)
            deed.do(page)
            if deed.words.startswith(WAITS):
                _settle(page)
                seen.look(page)
        if page.snapshot.playing and page.snapshot.target_speed >= 1:
            wait_until(lambda: _time(page) > BEGUN or page.snapshot.status.failed, f"t = {BEGUN:g} s")
        _settle(page)
        seen.look(page)
    try:
        wait_until(page.page.locator(".fl-done").count, f"lesson {number} is done")
    except AssertionError as error:
        raise AssertionError(f"{error}; the lab says: {_verdict(page)}") from None
    say(_verdict(page))
    seen.look(page)
    return seen


BEGUN = 1.2
"""Shortest time that a person watches a new run, simulated s."""
UPDATES = 10
"""Updates of the readouts to wait for: guide and explanations check every fourth, and an explanation appears when found twice.
The readouts of a run at rest do not change: the wait ends after 20 s, when the page has caught up."""
FOLLOW = """async (count) => {
  const read = () => document.querySelector(".fl-grid")?.textContent;
  const stopped = () => [...document.querySelectorAll(".fl-title")].some((title) => title.textContent === "Stopped");
  const late = Date.now() + 20000;
  for (let last = read(); count > 0 && Date.now() < late && !stopped(); await new Promise((done) => setTimeout(done, 40))) {
    if (read() !== last) count -= 1;
    last = read(); } }"""
WAITS = ("let ", "wait", "Wait", "Let", "after", "beyond")


def _settle(page: LabPage) -> None:
    """Wait until everything that follows the run has caught up with it."""
    if page.snapshot.playing and not page.snapshot.status.failed:
        page.page.evaluate(FOLLOW, UPDATES)


def _verdict(page: LabPage) -> str:
    return " ".join(page.page.locator(".fl-done, .fl-info").all_inner_texts())


def _plain(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<svg.*?</svg>", "", text, flags=re.S))


def _base(value: float, unit: str) -> tuple[float, str]:
    return value * SMALL.get(unit, 1.0), BASE.get(unit, unit)


def _time(page: LabPage) -> float:
    return float(page.snapshot.latest.time[0])


def _run_for(count: str) -> Callable[[LabPage], None]:
    seconds = WORDS.get(count) or float(count)

    def wait(page: LabPage) -> None:
        until = _time(page) + seconds
        wait_until(lambda: _time(page) >= until or page.snapshot.status.failed, f"{seconds:g} s go by")

    return wait


def _run_to(time: str) -> Callable[[LabPage], None]:
    return lambda page: wait_until(lambda: _time(page) > float(time), f"t = {time} s") and None


def _load(preset: str) -> Callable[[LabPage], None]:
    def load(page: LabPage) -> None:
        run = page.snapshot.run_number
        page.choose("Preset", preset)
        wait_until(lambda: page.snapshot.run_number > run and page.snapshot.name == preset, f"{preset} runs")

    return load


def _reset(page: LabPage) -> None:
    run = page.snapshot.run_number
    page.key("r")
    wait_until(lambda: page.snapshot.run_number > run, "R begins a new run")


def _toggle(page: LabPage) -> None:
    playing = page.snapshot.playing
    page.key("Space")
    wait_until(lambda: page.snapshot.playing != playing, "Space holds the run or lets it go on")


def _control(page: LabPage, name: str) -> Locator:
    """The control that a text means by a name: the box, menu or switch whose label begins with it."""
    label = re.compile(rf"^{re.escape(name)}( (?!.*slider).*)?$")
    found = page.page.get_by_label(label).or_(page.page.get_by_role("combobox", name=label))
    if not found.first.is_visible():
        _title(page, "Parameters").click()
    found.first.wait_for(state="visible", timeout=1000 * PATIENCE)
    return found.first


def _set(names: str, value: str) -> Callable[[LabPage], None]:
    first, *others = re.split(r", | and ", names)
    kind = first.rpartition(" ")[0]

    def enter(page: LabPage) -> None:
        for name in (first, *(f"{kind} {other}" for other in others)):
            before, control = page.snapshot.scenario, _control(page, name)
            if control.get_attribute("role") == "combobox" or control.get_attribute("aria-haspopup") == "listbox":
                control.click()
                page.page.get_by_role("option", name=in_words(value), exact=True).click()
            else:
                control.fill(value)
            page.page.wait_for_timeout(200)
            wait_until(lambda before=before: page.snapshot.scenario != before, f"{name} is {value}")

    return enter


def _by_symbol(symbol: str, value: str) -> Callable[[LabPage], None]:
    def enter(page: LabPage) -> None:
        before = page.snapshot.scenario
        page.page.get_by_label(re.compile(rf" {symbol} \((?!.*slider)")).first.fill(value)
        wait_until(lambda: page.snapshot.scenario != before, f"{symbol} is {value}")

    return enter


def _speed(value: str) -> Callable[[LabPage], None]:
    return lambda page: page.choose("Speed", f"{value} ×")


def _folder(name: str) -> Callable[[LabPage], None]:
    def unfold(page: LabPage) -> None:
        _title(page, "Parameters").click()
        inputs = page.page.locator("input:visible")
        shown = inputs.count()
        for _ in range(2):  # The first click closes a folder that was already open.
            _title(page, name).click()
            page.page.wait_for_timeout(500)
            if inputs.count() > shown:
                return

    return unfold


def _tab(name: str) -> Callable[[LabPage], None]:
    return lambda page: _title(page, name).click()


def _title(page: LabPage, name: str) -> Locator:
    """The title of a tab or folder, not the same words in the text of the lesson (`em`)."""
    return page.page.get_by_text(name, exact=True).and_(page.page.locator(":not(em)")).first


def _switch_on(name: str) -> Callable[[LabPage], None]:
    def turn(page: LabPage) -> None:
        before = page.snapshot.scenario
        page.switch(name)
        wait_until(lambda: page.snapshot.scenario != before, f"{name} is on")

    return turn


GRAMMAR: tuple[tuple[str, Callable[..., Callable[[LabPage], None]]], ...] = (
    (r"[Ll]oad the preset `([\w-]+)`", _load),
    (r"[Ss]et the speed (?:back )?to ([\d/]+)", _speed),
    (r"[Pp]ress R\b", lambda: _reset),
    (r"[Pp]ress Space\b", lambda: _toggle),
    (r"(?:[Ll]et it run|[Ww]ait) for (?:about )?(\w+) (?:second|period of the path)s?", _run_for),
    (r"(?:[Ll]et (?:it|the run) (?:go on |run )(?:beyond|to)|after) t = ([\d.]+) s", _run_to),
    (r"[Tt]urn \*\*([^*]+)\*\* on", _switch_on),
    (rf"[Gg]ive {NAME} a wrong frequency, ([\d.]+) Hz", _set),
    (rf"(?:[Ss]et )?{NAME}(?: back)? to ([\w-]+(?:\.\d+)?(?:e-\d+)?)", _set),
    (r"(?:[Ss]et|go on to) (ε|EI)(?: back)? (?:to|=) (\d+(?:\.\d+)?)", _by_symbol),
    (r"folder \*([^*]+)\*", _folder),
    (r"[Oo]pen the tab \*([^*]+)\*", _tab),
)
"""Phrases of lessons, and what they mean; words that several patterns match belong to the first of them."""
