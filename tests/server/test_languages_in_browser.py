"""Every page in German, in Chinese, and back in English: what a reader sees comes from the catalogue of their language."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_window import open_window
from full_server import PAGES, full_server
from person import TEACHER
from playwright.sync_api import Browser, Page
from waiting import wait_until

from flexlab.control.law import laws
from flexlab.control.path import PATHS
from flexlab.guide import chapters, lessons
from flexlab.presets import load_preset, preset_names

GUIDE, PANEL = '[data-dock-region="left"]', '[data-dock-region="right"]'
CALM = 1200
"""Time in which a page names and translates new elements, ms."""
STAYS = (
    r"\S+\.rrd|https?://\S+|x\d+_\d+ .*",  # files, addresses, machines
    r"(Edit props for )?/?(WorldAxes|\w+)",  # viser's tree of the scene, and single code names
    r"\d+ [A-Z][a-z]{2}( \d+)? [\d:]+|alpha [\d:]+|Lesson 0",  # dates, folders, what is typed here
    r".*[√∑‖].*",  # formulas
    r"[a-z]+(-[a-z]+)+",  # code names
)
"""Patterns of texts that stay the same in every language."""
ENGLISH = re.compile(r"[A-Za-z]{3,}(?:[ ’'-][A-Za-z]{3,}){2,}")
"""Three English words in a row."""
INDEXED = """() => [...document.querySelectorAll('sub')].map(
  (index) => `${index.previousSibling.nodeValue.slice(-1)}_${index.textContent}`)"""
"""Finds the symbols with a subscript, such as e_x."""
VISIBLE = """() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
  while (walker.nextNode()) {
    const part = walker.currentNode.parentElement;
    if (!part.checkVisibility() || part.closest("script, style, code, svg, [translate=no]")) continue;
    found.push(walker.currentNode.nodeValue);
  }
  return found;
}"""


@pytest.fixture(scope="module")
def page(
    plain_chromium: Browser, recorded: Path, tmp_path_factory: pytest.TempPathFactory, few_pictures: None
) -> Iterator[Page]:
    """A window whose reader prefers German, at the page that asks for the token; the server has two runs and a leaderboard."""
    with full_server(tmp_path_factory.mktemp("languages"), recorded) as address:
        window = open_window(plain_chromium, 1440, 900, base_url=address, locale="de-DE")
        opened = window.new_page()
        opened.route("**/viewer/**", lambda request: request.abort())
        said: list[str] = []
        opened.on("console", lambda message: said.append(message.text))
        opened.goto("/")
        yield opened
        assert not [text for text in said if "inline style violates" in text]
        window.close()


def plain(text: str) -> str:
    """A text without markup and with 0 for each number, as in a page's list of untranslated texts."""
    return " ".join(re.sub(r"\d[\d.e+−-]*", "0", re.sub(r"[`*\[\]#|>-]|!\[|\(\S+\.svg\)", " ", text)).split())


def told_by_files() -> str:
    """Texts that may stay English: the guide's chapters, and lessons, presets, laws and paths, which one file can add."""
    texts = [text for chapter in chapters() for text in (re.sub("<[^>]*>", " ", chapter.text), chapter.text)]
    texts += [text for lesson in lessons() for text in (lesson.title, lesson.text, lesson.check)]
    texts += [text for name in preset_names() for text in (name, load_preset(name).title, load_preset(name).watch)]
    texts += [*laws(), *PATHS.all()]
    return " · ".join(plain(text) for text in texts)


def left(page: Page) -> set[str]:
    """The texts of a page that have no translation."""
    page.wait_for_function("() => window.flexlabUntranslated")  # On a busy machine its script may load late.
    return set(page.evaluate("[...window.flexlabUntranslated]"))


def faults(missing: set[str]) -> list[str]:
    """The texts that need a translation, without those that may stay as they are."""
    stays, files = re.compile("|".join(f"(?:{kind})" for kind in STAYS)), told_by_files()
    return sorted(text for text in missing if not stays.fullmatch(text) and plain(text) not in files)


VERDICT = (
    "The ring of 1.59 mm fell to one per cent within 0.12 s with a clock of 1 ms and 1 ms of delay, from noisy gauges, and "
    "torques jump by 0.8 N·m (RMS) per step only. 1.3 µm of vibration is left after a second; slow bending of "
    "up to 0.15 mm stays ✓"
)
"""Two sentences of a lesson's check; the second begins with a number."""


WIDTH_OF_DOT = """(part) => {
  const text = [...part.childNodes].find((node) => node.nodeValue?.includes('·')), at = text.nodeValue.indexOf('·');
  const range = document.createRange();
  range.setStart(text, at);
  range.setEnd(text, at + 1);
  return range.getBoundingClientRect().width / parseFloat(getComputedStyle(part).fontSize); }"""


def told_of_fields(page: Page) -> list[str]:
    """How a page shows sentences written for the terminal, which name fields as in code."""
    sentences = (
        "Observer = Kalman filter · kalman",
        "a coarser pose accuracy (simulation.accuracy)",
        "A step of 0.01 s (simulation.step) is unstable with rk4: the grips allow at most 0.001 s.",
        "a lower stiffness or damping of the grips (grips.stiffness, grips.damping)",
        "an automatic step (simulation.step = null), a softer, lighter or less damped beam, or fewer elements",
        VERDICT,
        "(see example.com)",
    )
    page.evaluate(
        """(sentences) => {
          const place = Object.assign(document.createElement('div'), { id: 'told' });
          for (const text of sentences)
            place.append(Object.assign(document.createElement('p'), { textContent: text, title: text }));
          const code = Object.assign(document.createElement('code'), { textContent: '(simulation.accuracy)' });
          place.append(document.createElement('p'));
          place.lastChild.append(code);
          document.body.append(place); }""",
        sentences,
    )
    page.wait_for_timeout(CALM / 4)
    told = page.locator("#told p").all_inner_texts()
    assert page.evaluate("[...document.querySelectorAll('#told p[title]')].map((part) => part.title)") == told[:-1]
    return told


def told_to_a_class(page: Page) -> set[str]:
    """Texts without a translation while a teacher sets the class's pace, locks its labs and unlocks them."""
    page.goto("/teacher")
    rules, said, missing = page.locator("#rules"), page.locator("#said"), set()
    lesson, step, lock = rules.locator("[name=lesson]"), rules.locator("[name=step]"), rules.locator("[name=lock]")
    page.get_by_text(re.compile(r"Schritt \d von 3 \(")).first.wait_for()
    for change, sentence in (
        (lock.check, "Jeder wählt seine Lektion; niemand kann starten."),
        (lambda: lesson.select_option(index=1), "niemand kann starten."),
        (lock.uncheck, "Alle sind bei Schritt 3 von 3 (beobachten) von „Lektion 1"),
        (lambda: lesson.select_option(index=0), "Jeder wählt seine Lektion; alle können starten."),
        (lambda: lesson.select_option(index=1), "Alle sind bei Schritt 3 von 3"),
        (lambda: step.select_option(index=1), "Alle sind bei Schritt 2 von 3 (durchführen)"),
    ):
        change()
        said.filter(has_text=sentence).wait_for()
        missing |= left(page)
    return missing


def test_every_page_speaks_german_chinese_and_english(page: Page) -> None:
    page.locator("html[lang=de]").wait_for()
    page.get_by_role("heading", name="Anmelden").wait_for()
    missing = left(page)
    page.locator("input[name=token]").fill(TEACHER)
    page.get_by_role("button", name="Öffnen").click()
    page.get_by_role("link", name="Klasse").wait_for()
    for path in (*PAGES, "/nowhere"):
        page.goto(path)
        page.locator("h1").wait_for()
        page.locator(".progress[data-working]").wait_for(state="detached")
        missing |= left(page)
    page.goto("/runs")
    for width in (1366, 1280, 1024):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate(
            "() => { const { scrollWidth, clientWidth } = document.querySelector('.table'); "
            "return scrollWidth <= clientWidth; }"
        ), f"the table of runs scrolls at {width} px"
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto("/leaderboard")
    page.locator("img.figure[src^='data:']").first.wait_for(state="attached")
    assert {"w_qs", "e_x"} <= set(page.evaluate(INDEXED)), "symbols have real subscripts"
    shown = told_of_fields(page)
    assert shown[0] == "Beobachter\xa0=\xa0Kalman-Filter · kalman", "a law's setting on the leaderboard"
    assert "Genauigkeit" in shown[1], "titles in words, without the names that they have in code"
    assert not re.search(r"[a-z]\.[a-z]", " ".join(shown[:-2])), shown
    assert shown[-2:] == ["(see example.com)", "(simulation.accuracy)"], "what a person or a program wrote stays"
    page.goto("/lab/?play")
    page.get_by_role("button", name="Antippen").wait_for()
    page.get_by_role("slider", name="Steifigkeit EI", exact=True).wait_for()
    page.get_by_role("button", name="Mehr").click()
    page.get_by_role("slider", name="Biegesteifigkeit EI", exact=True).wait_for()
    for folded in ("Anleitung", "Bewegung"):
        page.get_by_role("tab", name=folded, exact=True).press("Enter")
    menu = page.locator(f"{GUIDE} input[aria-haspopup=listbox]").first
    offered = page.get_by_role("option", name="Lektion 1: Warum schwingt er?")

    def looked_for() -> bool:
        menu.fill("Lesson 1")  # A panel that is just unfolding closes its menus.
        page.wait_for_timeout(500)
        return offered.is_visible()

    wait_until(looked_for, "the lesson is offered")
    offered.click()
    page.locator(GUIDE).get_by_text("In der Vorgabe").first.wait_for()
    assert (
        page.locator(f"{GUIDE} [data-fl-shown]").first.get_attribute("data-fl-shown") == "Lektion 1: Warum schwingt er?"
    )
    tabs = page.locator(f"{PANEL} [role=tab]")
    page.set_viewport_size({"width": 1024, "height": 768})
    page.wait_for_timeout(CALM / 2)
    cut = "names => names.filter((name) => name.scrollWidth > name.clientWidth).map((name) => name.textContent)"
    assert tabs.locator("span").evaluate_all(cut) == [], "the narrow panel shows the whole names of its tabs"
    page.set_viewport_size({"width": 1440, "height": 900})
    for number in range(tabs.count()):
        tabs.nth(number).press("Enter")
        for _ in range(2):  # Folders may hold folders.
            page.wait_for_timeout(CALM / 2)
            folded = page.locator(f"{PANEL} [data-fl-pressed][aria-expanded=false]")
            folded.evaluate_all("heads => heads.forEach((head) => head.click())")
    page.keyboard.press("Shift+?")
    page.get_by_role("dialog", name="Tasten").get_by_text("Laufen oder anhalten").wait_for()
    page.wait_for_timeout(CALM)
    missing |= left(page)
    page.keyboard.press("Escape")
    missing |= told_to_a_class(page)
    page.goto("/lab/")
    page.locator(GUIDE).get_by_text("Die Klasse ist bei Schritt 2 von 3 (durchführen).").wait_for()
    missing |= left(page)
    lacking = faults(missing)
    assert not lacking, "these lack in web_assets/languages/*.json:\n" + "\n".join(lacking)
    values = page.locator(".u-value:visible")
    values.filter(has_text=re.compile(r"\d\.\d")).first.wait_for()
    assert not [text for text in values.all_inner_texts() if "," in text], "numbers are the same in all"

    page.get_by_label("Language").select_option("zh")
    tabs.first.press("Enter")
    page.get_by_role("slider", name="抗弯刚度 EI", exact=True).wait_for()
    label = page.locator(PANEL).get_by_text("(N·m²)").first
    assert label.evaluate(WIDTH_OF_DOT) < 0.6, "the dot of units is narrow, in em"
    verdict = told_of_fields(page)[-3]
    assert "剩余振动 1.3" in verdict, "each sentence by itself, also one that begins with a number"
    page.locator("#told").evaluate("(part) => part.remove()")
    page.wait_for_timeout(CALM)
    shown = {found[0] for text in page.evaluate(VISIBLE) if (found := ENGLISH.search(text))}
    assert faults(shown) == []

    page.get_by_label("Language").select_option("en")
    page.get_by_role("slider", name="Bending stiffness EI", exact=True).wait_for()
    assert "Bending stiffness EI (N·m²)" in page.locator(PANEL).inner_text()
    assert page.locator("[data-fl-shown]").count() == 0
    assert "t_μ" in page.evaluate(INDEXED), "labels of the panel have real subscripts"
    assert not re.search(r"[a-z]\.[a-z]", " ".join(told_of_fields(page)[:-2])), "in English, too"
    page.get_by_label("Language").select_option("de")
    page.goto("/")
    assert page.locator("html").get_attribute("lang") == "de", "the choice is remembered"
