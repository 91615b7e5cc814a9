"""Three students on a real JupyterHub in a real browser, as .github/UNIVERSITY.md sets it up, word for word.

`python tests/peers/jupyter_hub.py FOLDER` runs its commands in FOLDER, needs node, npm and a Chromium, and takes minutes: the
suite does without. Everything is looked at as people see it, but for who listens where.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil

TESTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(TESTS), str(TESTS / "server")]

from browser_window import SOFTWARE_RENDERING, open_window  # noqa: E402
from get_browser import find_browser  # noqa: E402
from playwright.sync_api import Browser, Page, Response, sync_playwright  # noqa: E402
from test_server_in_browser import SCENE, wait_for_plots  # noqa: E402

from flexlab.presets import load_preset  # noqa: E402
from flexlab.recording.reader import read_recording  # noqa: E402

CHAPTER = TESTS.parent / ".github" / "UNIVERSITY.md"
HUB, PASSWORD = "http://127.0.0.1:8000", "choose-a-long-password"
STUDENTS = ("ann", "ben", "cleo")
PATIENCE = 900.0
"""s: each student's first lab compiles the engine, all at once."""
SHORT, LONGEST = 5.0, 100.0
"""s that a run goes on before its page is opened; and that it has at most when its file is read."""
MILLI = 1e3


def blocks(language: str) -> list[str]:
    """The chapter's examples in a language."""
    return re.findall(rf"```{language}\n(.*?)```", CHAPTER.read_text(encoding="utf-8"), re.DOTALL)


@contextmanager
def hub(folder: Path) -> Iterator[psutil.Process]:
    """The chapter's hub in a folder, which keeps what was installed there."""
    configuration = "".join(blocks("python"))
    if os.name == "posix" and os.geteuid() == 0:
        configuration += 'c.Spawner.args = ["--allow-root"]\n'  # Jupyter's own objection, not the chapter's.
    (folder / "jupyterhub_config.py").write_text(configuration, encoding="utf-8")
    [commands] = (block for block in blocks("sh") if "jupyterhub -f" in block)
    commands = re.sub(r"^FLEXLAB=\S+", f"FLEXLAB={TESTS.parent}", commands)
    before = {path for path in ("bin", "Scripts") if (Path(sys.prefix) / path).is_dir()}
    plain = {name: value for name, value in os.environ.items() if name not in ("VIRTUAL_ENV", "PYTHONPATH")}
    plain["PATH"] = os.pathsep.join([*(str(Path(sys.base_prefix) / path) for path in before), plain["PATH"]])
    with open(folder / "hub.log", "w", encoding="utf-8") as log:
        process = subprocess.Popen(
            ["bash", "-ec", commands], cwd=folder, env=plain, stdout=log, stderr=log, start_new_session=True
        )
        try:
            while "JupyterHub is now running" not in (folder / "hub.log").read_text(encoding="utf-8"):
                assert process.poll() is None, f"see {folder / 'hub.log'}"
                time.sleep(1)
            yield psutil.Process(process.pid)
        finally:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(60)


def sign_in(page: Page, name: str) -> None:
    """On the hub's page, which leads on to where somebody wanted to go."""
    page.locator("#username_input").fill(name)
    page.locator("#password_input").fill(PASSWORD)
    page.locator("#login_submit").click()


def log_in(page: Page, name: str) -> None:
    """To the launcher of a student's own server."""
    page.goto(HUB)
    sign_in(page, name)
    page.locator(".jp-LauncherCard", has_text="flexlab").first.wait_for()


class Student:
    """One browser window with its own cookies, whose errors count."""

    def __init__(self, browser: Browser, name: str, drawn: bool):
        self.name, self.errors, self.redirects = name, [], []
        self.note = f"by {name} at {time.time():.0f}"  # The homes may have runs of an earlier try.
        self.window = open_window(browser, 1280, 800, drawn=drawn)
        self.window.on("response", self.note_redirect)
        self.window.set_default_timeout(MILLI * PATIENCE)
        self.jupyter = self.window.new_page()
        log_in(self.jupyter, name)
        say(name, "is in the launcher")

    def note_redirect(self, answer: Response) -> None:
        """Where flexlab's pages send the browser."""
        if f"/user/{self.name}/flexlab" in answer.url and "location" in answer.headers:
            self.redirects.append(answer.headers["location"])

    def open_lab(self) -> None:
        """A click in the launcher; the page may still wait for the engine."""
        with self.window.expect_page() as opened:
            self.jupyter.locator(".jp-LauncherCard", has_text="flexlab").first.click()
        self.lab = opened.value
        self.lab.on("pageerror", lambda error: self.errors.append(str(error)))

    def use_lab(self) -> None:
        """The scene is there, a slider moves what it is for."""
        self.lab.wait_for_function(SCENE)
        self.lab.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        assert self.lab.url.partition("?")[0] == f"{HUB}/user/{self.name}/flexlab/lab/", self.lab.url
        slider = self.lab.get_by_role("slider", name="Bending stiffness EI", exact=True)
        slider.focus()
        slider.press("Home")
        self.lab.wait_for_function("() => document.body.innerText.includes('first beam frequency')")
        self.lab.wait_for_function("() => /4\\.4\\d Hz/.test(document.body.innerText)")  # EI = 1 N·m²
        say(self.name, "moved the beam's stiffness from 45 Hz to 4.5 Hz")

    def keep_run(self, folder: Path) -> None:
        """A new run's page draws it, marks it as one to keep, and gives the file."""
        # The first run went on while the labs compiled: jupyter-server-proxy passes on no file above 100 MB.
        self.lab.get_by_role("button", name="Reset", exact=True).click()
        self.lab.wait_for_timeout(MILLI * SHORT)
        self.lab.locator("#server-bar").get_by_role("link", name="Runs").click()
        self.lab.locator("#runs tbody a").first.click()
        self.lab.locator("summary", has_text="Note and tags").click()
        self.lab.locator("input[name=keep]").check()
        self.lab.locator("textarea[name=note]").fill(self.note)
        self.lab.get_by_role("button", name="Save").click()
        wait_for_plots(self.lab, f"hub-{self.name}", PATIENCE)
        with self.lab.expect_download() as download:
            self.lab.get_by_role("link", name="Download").click()
        file = folder / f"{self.name}.rrd"
        download.value.save_as(file)
        time_span = read_recording(file).samples.time
        assert time_span[-1] < LONGEST, f"{time_span[-1]} s: not the run that began anew"
        say(self.name, f"sees the run in the viewer and has its file: {time_span[-1]:.1f} s")

    def has_runs(self) -> None:
        """After coming back: the run that was kept is listed."""
        self.lab = self.window.new_page()
        self.lab.goto(f"{HUB}/user/{self.name}/flexlab/runs")
        self.lab.locator("#runs tr", has_text=self.note).locator(".kept").wait_for()


def check_redirects(student: Student) -> None:
    """jupyter-server-proxy puts its prefix before some redirects itself: none has it twice."""
    assert student.redirects, "saving a note leads back to the run"
    twice = [address for address in student.redirects if address.count(f"/user/{student.name}/") > 1]
    assert not twice, twice
    say(f"{student.name} was redirected to", *sorted({address.partition("?")[0] for address in student.redirects}))


def say(*words: str) -> None:
    """With the time since the start, s."""
    print(f"{time.monotonic() - BEGUN:6.1f}", *words, flush=True)


BEGUN = time.monotonic()


def listeners(process: psutil.Process) -> set[str]:
    """Addresses on which the hub and all that it started listen."""
    family = [process, *process.children(recursive=True)]
    plugs = [plug for each in family for plug in each.net_connections("inet") if plug.status == psutil.CONN_LISTEN]
    return {plug.laddr.ip for plug in plugs}


def teach(browser: Browser) -> None:
    """The teacher sees all labs, sends a preset, pauses one, joins one; a student does not get that far."""
    window = open_window(browser, 1280, 800)
    window.set_default_timeout(MILLI * PATIENCE)
    page = window.new_page()
    page.goto(f"{HUB}/services/flexlab/")
    sign_in(page, "teacher")
    tiles = page.locator("#labs > *")
    for name in STUDENTS:
        tiles.filter(has_text=name).wait_for()
    page.once("dialog", lambda ask: ask.accept())
    page.locator("select[name=preset]").select_option("stiff-beam")
    page.get_by_role("button", name="Send to all").click()
    page.locator("#said", has_text="was sent to 3 labs").wait_for()
    for name in STUDENTS:
        tiles.filter(has_text=name).locator(".lab-title", has_text=load_preset("stiff-beam").title).wait_for()
    tile = tiles.filter(has_text="ben")
    tile.get_by_role("button", name="Pause").click()
    tile.locator("[data-field=state]", has_text="paused").wait_for()
    with window.expect_page() as joined:
        tile.get_by_role("link", name="Join").click()
    joined.value.wait_for_function(SCENE)
    assert joined.value.url.startswith(f"{HUB}/user/ben/flexlab/lab/"), joined.value.url
    window.close()
    window = open_window(browser, 1280, 800)
    page = window.new_page()
    page.goto(f"{HUB}/services/flexlab/teacher")
    with page.expect_response(lambda answer: "oauth2/authorize" in answer.url) as refused:
        sign_in(page, STUDENTS[0])
    assert refused.value.status == 403, refused.value.status
    assert "Class" not in page.title(), page.title()
    window.close()
    say("the teacher sees, sends, pauses and joins; a student is refused")


def main(folder: Path) -> None:
    """All of it; raises where something is not as the chapter says."""
    with ExitStack() as ending:
        running = ending.enter_context(hub(folder))
        say("the hub runs")
        playwright = ending.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=find_browser(), args=SOFTWARE_RENDERING)
        students = [Student(browser, name, drawn=name == STUDENTS[0]) for name in STUDENTS]
        for each in students:
            each.open_lab()
        for each in students:
            each.use_lab()
        found = listeners(running)
        assert found <= {"127.0.0.1", "::1"}, found
        say("all listen on", *found, "only")
        for each in students:
            each.keep_run(folder)
            for other in set(STUDENTS) - {each.name}:
                answer = each.window.request.get(f"{HUB}/user/{other}/flexlab/runs")
                assert answer.status in (403, 404), answer.status
        say("nobody gets into a neighbour's lab")
        teach(browser)
        for each in students:
            each.jupyter.goto(f"{HUB}/hub/home")
            each.jupyter.locator("#stop").click()
            each.jupyter.locator("#stop").wait_for(state="hidden")
            each.jupyter.goto(f"{HUB}/hub/logout")
            answer = each.window.request.get(f"{HUB}/user/{each.name}/flexlab/runs", max_redirects=0)
            assert answer.status in (302, 403), answer.status
            log_in(each.jupyter, each.name)
            each.has_runs()
            assert each.errors == [], each.errors
            check_redirects(each)
        say("after stopping their servers and logging in again all have their runs")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
