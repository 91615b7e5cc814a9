"""A lab as a person sees it: helpers that look at and touch the page of a running session."""

import itertools
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from browser_window import AT_ONCE, DRAW, PICTURES, REST, open_window
from playwright.sync_api import Browser, Locator, TimeoutError
from waiting import ARTIFACTS, PATIENCE
from waiting import wait_until as wait_until

from flexlab.lab.scene.beam import GRAB_SIDES
from flexlab.lab.session import Session
from flexlab.lab.view_settings import ViewSettings
from flexlab.presets import load_preset
from flexlab.scenario.field_text import TITLES, in_words
from flexlab.sim.commands import Pause, Play, SetSpeed

THROUGH_THE_GATE = "() => new Promise((done) => setTimeout(done, 150))"
"""The page sends all inputs through one 50 ms gate: of two widgets changed within it, the first change can be lost. So wait
before the next input, by the page's own clock: on a busy machine the page may lag far behind."""
SAME_PLACE = 1e-3
"""Distance below which two positions of the camera count as the same, m."""
LOOK = 100
"""Time between two looks at the text of a page, ms; each look makes the page compute its layout."""
EI = "Bending stiffness EI (N·m²)"

WORDS = itertools.count()

READY = """() => window.__viserMutable?.nodeRefFromName?.['/beam'] != null
  && window.__viserTestpoints.rendererInfo.render.frame > 2"""
SHOWS = "(text) => document.body.innerText.replaceAll('\\u00a0', ' ').includes(text.replaceAll('\\u00a0', ' '))"
CLOSE_NOTIFICATIONS = """() => {
  for (const button of document.querySelectorAll('.mantine-Notification-closeButton')) button.click(); }"""
PLOTS_OPEN = """() => Object.values(window.__viserTestpoints?.uplots ?? {})
  .some(({ chart }) => chart.root.offsetParent !== null)"""
GUIDE_OPEN = "() => Boolean(document.querySelector('.fl-guide')?.getClientRects().length)"
ONE_COLUMN = 960
"""Widest page, px, with one column, in which plots and guide are at the head of the sheet."""
FRAMES = "window.__viserTestpoints?.rendererInfo?.render.frame ?? 0"
DRAWN_SINCE = """(frame) => window.__viserMutable?.nodeRefFromName?.['/beam'] != null
  && window.__viserTestpoints.rendererInfo.render.frame > frame + 2"""
MID_VERTEX = """() => {
  let found = null;
  window.__viserMutable.nodeRefFromName['/beam']?.traverse((node) => {
    const position = node.geometry?.attributes?.position;
    if (position && found === null) { const i = Math.floor(position.count / 2);
      found = [position.getX(i), position.getY(i), position.getZ(i)]; } });
  return found; }"""


BEAM_PIXEL = """(sides) => {
  const mutable = window.__viserMutable; let point = null;
  mutable.nodeRefFromName['/grab'].traverse((node) => {
    const position = node.geometry?.attributes?.position;
    if (!position || point) return;
    // The ring at mid-span: of a bent beam, the middle of all vertices is beside it.
    const first = (position.count - sides) / 2;
    let [x, y, z] = [0, 0, 0];
    for (let i = first; i < first + sides; i++) {
      x += position.getX(i); y += position.getY(i); z += position.getZ(i); }
    const center = mutable.camera.position.clone();
    point = center.set(x / sides, y / sides, z / sides).applyMatrix4(node.matrixWorld); });
  point.project(mutable.camera);
  const box = mutable.canvas.getBoundingClientRect();
  return [box.left + (point.x + 1) / 2 * box.width, box.top + (1 - point.y) / 2 * box.height]; }"""

BEAM = """(sides) => {
  const mutable = window.__viserMutable; let ends = null;
  mutable.nodeRefFromName['/beam'].traverse((node) => {
    const position = node.geometry?.attributes?.position;
    if (!position || ends) return;
    const box = mutable.canvas.getBoundingClientRect();
    const at = (first) => {
      let [x, y, z] = [0, 0, 0];
      for (let i = first; i < first + sides; i++) {
        x += position.getX(i); y += position.getY(i); z += position.getZ(i); }
      const point = mutable.camera.position.clone().set(x / sides, y / sides, z / sides);
      point.applyMatrix4(node.matrixWorld).project(mutable.camera);
      return [box.left + (point.x + 1) / 2 * box.width, box.top + (1 - point.y) / 2 * box.height]; };
    const middle = (position.count / sides - 1) / 2 * sides;
    ends = [at(sides), at(middle - middle % sides), at(position.count - 2 * sides)]; });
  return ends; }"""
"""Positions of one end, the middle and the other end of the drawn beam, px."""


POINT_PIXEL = """([x, y, z]) => {
  const mutable = window.__viserMutable;
  const point = mutable.camera.position.clone().set(x, y, z);
  point.applyMatrix4(mutable.nodeRefFromName['/arms'].matrixWorld).project(mutable.camera);
  const box = mutable.canvas.getBoundingClientRect();
  return [box.left + (point.x + 1) / 2 * box.width, box.top + (1 - point.y) / 2 * box.height]; }"""


def address(session: Session, coarsely: bool = True) -> str:
    """The address of a lab's page; `coarsely`: drawn in 9 % of the pixels, for tests that do not look closely."""
    return f"{session.url}/?fixedDpr={0.3 if coarsely else 1}"


class LabPage:
    """One browser window on one session; a context manager. `coarsely`: see `address`."""

    def __init__(
        self,
        browser: Browser,
        session: Session,
        size: tuple[int, int] = (1440, 900),
        coarsely: bool = True,
        **options: Any,
    ):
        self.session = session
        self._context = open_window(browser, *size, accept_downloads=True, **options)
        self.page = self._context.new_page()
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        # viser reports what came for a removed widget to the console only.
        lost = "update non-existent component"
        self.page.on("console", lambda told: self.errors.extend([told.text] if lost in told.text else ()))
        self.page.goto(address(session, coarsely))

    def __enter__(self) -> "LabPage":
        self.page.wait_for_function(READY, timeout=1000 * PATIENCE)
        self._close_notifications()
        if self.page.viewport_size["width"] > ONE_COLUMN:  # type: ignore[index]  # Every test's window has a size.
            self.open_panels()
        return self

    def open_panels(self) -> None:
        """Open the plots and the guide, which are folded on a first visit."""
        for name, is_open in (("Motion", PLOTS_OPEN), ("Guide", GUIDE_OPEN)):
            self.page.get_by_text(name, exact=True).first.click()
            self.page.wait_for_function(is_open, timeout=1000 * PATIENCE)

    def __exit__(self, *_: object) -> None:
        self._context.close()

    def come_back(self, session: Session) -> None:
        """Show a new session at the address of an earlier one by reloading the page; plots and guide stay open."""
        self.session = session
        self.errors.clear()
        self.page.reload()
        self.page.wait_for_function(READY, timeout=1000 * PATIENCE)
        for is_open in (PLOTS_OPEN, GUIDE_OPEN):  # The browser remembers them.
            self.page.wait_for_function(is_open, timeout=1000 * PATIENCE)
        self._close_notifications()

    def rest(self, rests: bool = True) -> None:
        """Stop drawing, or draw again if `rests` is false."""
        self.page.evaluate(REST, rests)

    @contextmanager
    def drawn(self) -> Iterator[None]:
        """Draw the pixels of the scene meanwhile, which what begins in here can look at."""
        self.page.evaluate(DRAW, True)
        self._wait_for_frames()
        yield
        if not PICTURES:
            self.page.evaluate(DRAW, False)

    def begin_anew(self, plays: bool = True) -> None:
        """Load the paper's preset, seen as usual, and play it at full speed or hold it at its start; the undo history stays."""
        self.errors.clear()
        self.rest(False)
        run, paper = self.snapshot.run_number, load_preset("paper")
        self.session.lab_state.kept = None
        self.session.lab_state.set_view(**vars(ViewSettings()))
        self.session.lab_state.load(paper, "paper")
        self.session.lab_state.say("")
        self.session.lab_state.submit(SetSpeed(1.0))
        self.session.lab_state.submit(Play() if plays else Pause())

        def begun() -> bool:
            now = self.snapshot
            return now.run_number > run and now.scenario == paper and now.playing == plays and now.target_speed == 1.0

        wait_until(begun, "a new run of the paper's preset")
        cameras: Any = self.session._cameras
        for client in self.session.server.get_clients().values():
            cameras.choose(client, "First view")  # The view of a new window; the button would need another tab.
        self.wait_for_camera()
        self.open_tab("Parameters")
        self._close_notifications()
        wait_until(lambda: self.box(EI).input_value() == "100", "the page shows its stiffness")

    def wait_for_camera(self) -> None:
        """Wait until the camera has come to where the lab has put it: it glides there."""
        cameras: Any = self.session._cameras
        wait_until(
            lambda: any(math.dist(self.camera(), seen.put_at) < SAME_PLACE / 2 for seen in cameras._watches.values()),
            "the camera shows its view",
        )

    def hold(self) -> None:
        """Pause the simulation, and wait until it has stopped."""
        wait_until(lambda: self.snapshot.playing, "the simulation runs")
        self.key("Space")
        wait_until(lambda: not self.snapshot.playing, "the simulation holds")

    def catch_up(self) -> None:
        """Wait until the page draws what the lab has now.

        Messages keep their order, and those of a picture come before its words. So once the page has shown one word, the next
        word belongs to a picture that was begun after everything requested before this call.
        """
        for _ in range(2):
            word = f"look {next(WORDS)}"
            self.session.lab_state.say(word)
            self.wait_for_text(word)
        self._wait_for_frames()

    def _wait_for_frames(self) -> None:
        frame = self.page.evaluate(FRAMES)
        self.page.evaluate(AT_ONCE, 3)
        self.page.wait_for_function(DRAWN_SINCE, arg=frame, timeout=1000 * PATIENCE)

    def _close_notifications(self) -> None:
        self.page.evaluate(CLOSE_NOTIFICATIONS)

    @property
    def snapshot(self) -> Any:
        """The latest snapshot of the simulation."""
        return self.session.runner.snapshot

    def text(self) -> str:
        """All text of the page."""
        return self.page.locator("body").inner_text()

    def beam_vertex(self) -> list[float]:
        """Position of a vertex in the middle of the drawn beam, m; waits for the beam of a new run."""
        return self.page.wait_for_function(MID_VERTEX).json_value()

    def box(self, label: str) -> Locator:
        """The first number box with this label: both arms have the same labels, and some fields several numbers."""
        return self.page.get_by_label(re.compile(rf"^{re.escape(label)}(, 1 of \d)?$")).first

    def enter(self, label: str, value: str) -> None:
        """Type a number into a box."""
        self.box(label).fill(value)
        self.box(label).press("Enter")
        self.page.evaluate(THROUGH_THE_GATE)

    def write(self, label: str, text: str) -> None:
        """Write into a text box, whose label viser does not link to the input."""
        row = self.page.locator("label", has_text=label).locator("xpath=../../..")
        row.locator("input").fill(text)
        self.page.evaluate(THROUGH_THE_GATE)

    def choose(self, label: str, option: str) -> None:
        """Choose from a menu."""
        menu = self.page.get_by_role("combobox", name=label).or_(self.page.get_by_label(label, exact=True)).first
        shown = in_words(option) if label in TITLES.values() else option
        offered = self.page.get_by_role("option", name=shown, exact=True)

        def is_open() -> bool:
            # A folder that is just unfolding moves its menus from under the pointer.
            if menu.get_attribute("aria-expanded") != "true":
                menu.click()
            return offered.is_visible()

        wait_until(is_open, f"the menu {label} offers {shown}")
        offered.click()
        self.page.evaluate(THROUGH_THE_GATE)

    def press(self, button: str) -> None:
        """Press a button."""
        self.page.get_by_role("button", name=button, exact=True).click()
        self.page.evaluate(THROUGH_THE_GATE)

    def open_tab(self, name: str) -> None:
        """Bring a tab of the panel to the front."""
        self.page.get_by_text(name, exact=True).first.click()

    def wait_for_text(self, text: str) -> None:
        """Wait until the page shows a text."""
        try:
            self.page.wait_for_function(SHOWS, arg=text, timeout=1000 * PATIENCE, polling=LOOK)
        except TimeoutError:
            raise AssertionError(f"waited {PATIENCE:g} s in vain for: the page shows {text!r}") from None

    def switch(self, label: str) -> None:
        """Turn a switch on or off."""
        self.page.get_by_label(label, exact=True).click()
        self.page.evaluate(THROUGH_THE_GATE)

    def key(self, key: str) -> None:
        """Press a key while no text field has the focus."""
        self.page.evaluate("document.activeElement?.blur()")
        self.page.keyboard.press(key)
        self.page.evaluate(THROUGH_THE_GATE)

    def camera(self) -> list[float]:
        """Position of the camera in the lab's axes, (x, y, z) m; in those of three.js y points up."""
        away, up, left = self.page.evaluate("window.__viserMutable.camera.position.toArray()")
        return [-left, -away, up]

    def beam_pixel(self) -> list[float]:
        """Position of the middle of the drawn beam on the page, px."""
        return self.page.evaluate(BEAM_PIXEL, GRAB_SIDES)

    def label(self, name: str) -> str:
        """Text of a label in the scene, empty while it is hidden; asked of the lab, as the page draws it as a picture."""
        handle: Any = self.session.server.scene._handle_from_node_name[name]
        return handle.text if handle.visible else ""

    def pixel(self, x: float, y: float, z: float) -> list[float]:
        """Position on the page, px, of a point of the scene, m."""
        return self.page.evaluate(POINT_PIXEL, [x, y, z])

    def picture(self, name: str) -> None:
        """Save a screenshot for people to look at, if they asked for pictures."""
        if not PICTURES:
            return
        ARTIFACTS.mkdir(exist_ok=True)
        self.page.screenshot(path=ARTIFACTS / f"{name}.png")
