"""A lab as a person sees it: helpers that look at and touch the page of a running session."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator

from flexlab.lab.session import Session

PATIENCE = 60.0
"""Wall seconds that a browser drawing in software on a busy machine may take for anything."""
THROUGH_THE_GATE = "() => new Promise((done) => setTimeout(done, 150))"
"""The page sends all inputs through one 50 ms gate: two widgets changed within it can lose the first change. So the next one
waits, by the page's own clock: on a busy machine the page may be far behind ours."""
ARTIFACTS = Path(__file__).parents[2] / ".artifacts"

READY = """() => window.__viserMutable?.nodeRefFromName?.['/beam'] != null
  && window.__viserTestpoints.rendererInfo.render.frame > 2"""
MID_VERTEX = """() => {
  let found = null;
  window.__viserMutable.nodeRefFromName['/beam'].traverse((node) => {
    const position = node.geometry?.attributes?.position;
    if (position && found === null) { const i = Math.floor(position.count / 2);
      found = [position.getX(i), position.getY(i), position.getZ(i)]; } });
  return found; }"""


BEAM_PIXEL = """() => {
  const mutable = window.__viserMutable; let point = null;
  mutable.nodeRefFromName['/grab'].traverse((node) => {
    const position = node.geometry?.attributes?.position;
    if (!position || point) return;
    let [x, y, z] = [0, 0, 0];
    for (let i = 0; i < position.count; i++) {
      x += position.getX(i); y += position.getY(i); z += position.getZ(i); }
    const center = mutable.camera.position.clone();
    point = center.set(x / position.count, y / position.count, z / position.count).applyMatrix4(node.matrixWorld); });
  point.project(mutable.camera);
  const box = mutable.canvas.getBoundingClientRect();
  return [box.left + (point.x + 1) / 2 * box.width, box.top + (1 - point.y) / 2 * box.height]; }"""


POINT_PIXEL = """([x, y, z]) => {
  const mutable = window.__viserMutable;
  const point = mutable.camera.position.clone().set(x, y, z);
  point.applyMatrix4(mutable.nodeRefFromName['/arms'].matrixWorld).project(mutable.camera);
  const box = mutable.canvas.getBoundingClientRect();
  return [box.left + (point.x + 1) / 2 * box.width, box.top + (1 - point.y) / 2 * box.height]; }"""


def wait_until(ask: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    """Ask until the answer is true and return it; fails naming `what` and the last answer."""
    deadline = time.monotonic() + patience
    while True:
        answer = ask()
        if answer:
            return answer
        assert time.monotonic() < deadline, f"waited {patience:g} s in vain for: {what} (last answer: {answer!r})"
        time.sleep(0.05)


class LabPage:
    """One browser window on one session; a context manager."""

    def __init__(self, browser: Browser, session: Session, size: tuple[int, int] = (1440, 900), dark: bool = False):
        self.session = session
        self._context = browser.new_context(viewport={"width": size[0], "height": size[1]}, accept_downloads=True)
        self.page = self._context.new_page()
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(f"{session.url}/?fixedDpr=0.6{'&darkMode' if dark else ''}")

    def __enter__(self) -> "LabPage":
        self.page.wait_for_function(READY, timeout=1000 * PATIENCE)
        close = self.page.locator(".mantine-Notification-closeButton")
        if close.count():
            close.first.click()
        return self

    def __exit__(self, *_: object) -> None:
        self._context.close()

    @property
    def snapshot(self) -> Any:
        """What the simulation says."""
        return self.session.runner.snapshot

    def text(self) -> str:
        """All text of the page."""
        return self.page.locator("body").inner_text()

    def beam_vertex(self) -> list[float]:
        """Where a vertex in the middle of the drawn beam is, m."""
        return self.page.evaluate(MID_VERTEX)

    def box(self, label: str) -> Locator:
        """The first number box with a label: both arms have the same ones."""
        return self.page.get_by_label(label, exact=True).first

    def enter(self, label: str, value: str) -> None:
        """Type a number into a box."""
        self.box(label).fill(value)
        self.page.evaluate(THROUGH_THE_GATE)

    def write(self, label: str, text: str) -> None:
        """Write into a text box; viser ties its label to nothing."""
        row = self.page.locator("label", has_text=label).locator("xpath=../../..")
        row.locator("input").fill(text)
        self.page.evaluate(THROUGH_THE_GATE)

    def choose(self, label: str, option: str) -> None:
        """Choose from a menu."""
        self.page.get_by_role("combobox", name=label).or_(self.page.get_by_label(label, exact=True)).first.click()
        self.page.get_by_role("option", name=option, exact=True).click()
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
        wait_until(lambda: text in self.text(), f"the page shows {text!r}")

    def switch(self, label: str) -> None:
        """Turn a switch on or off."""
        self.page.get_by_label(label, exact=True).click()
        self.page.evaluate(THROUGH_THE_GATE)

    def key(self, key: str) -> None:
        """Press a key with the cursor in no text field."""
        self.page.evaluate("document.activeElement?.blur()")
        self.page.keyboard.press(key)
        self.page.evaluate(THROUGH_THE_GATE)

    def camera(self) -> list[float]:
        """Where the camera stands, (x, y, z) m; three.js has its own axes, y up."""
        away, up, left = self.page.evaluate("window.__viserMutable.camera.position.toArray()")
        return [-left, -away, up]

    def beam_pixel(self) -> list[float]:
        """Where the middle of the drawn beam is on the page, px."""
        return self.page.evaluate(BEAM_PIXEL)

    def label(self, name: str) -> str:
        """What the lab has a label in the scene say, empty while it is hidden; to the page its letters are a picture."""
        handle: Any = self.session.server.scene._handle_from_node_name[name]
        return handle.text if handle.visible else ""

    def pixel(self, x: float, y: float, z: float) -> list[float]:
        """Where a point of the scene, m, is on the page, px."""
        return self.page.evaluate(POINT_PIXEL, [x, y, z])

    def picture(self, name: str) -> None:
        """Keep a screenshot for people to look at."""
        ARTIFACTS.mkdir(exist_ok=True)
        self.page.screenshot(path=ARTIFACTS / f"{name}.png")
