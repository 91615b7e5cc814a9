"""Three students in a real browser on a real JupyterHub, which is set up exactly as .github/UNIVERSITY.md says.

`python tests/peers/jupyter_hub.py FOLDER` runs the chapter's commands in FOLDER. It needs node, npm and a Chromium and takes
minutes, so it is not in the suite. It checks what people see and who listens where, and leaves screenshots in FOLDER.
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
from urllib.parse import urljoin

import psutil

TESTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(TESTS), str(TESTS / "server")]

from browser_window import SOFTWARE_RENDERING, open_window  # noqa: E402
from get_browser import find_browser  # noqa: E402
from playwright.sync_api import Browser, Page, Request, Response, sync_playwright  # noqa: E402
from test_server_in_browser import SCENE, wait_for_plots  # noqa: E402

from flexlab.presets import load_preset  # noqa: E402
from flexlab.recording.reader import read_recording  # noqa: E402

CHAPTER = TESTS.parent / ".github" / "UNIVERSITY.md"
HUB, PASSWORD = "http://127.0.0.1:8000", "choose-a-long-password"
STUDENTS = ("ann", "ben", "cleo")
PATIENCE = 900.0
"""Longest wait, s: the first labs of all students compile the engine at the same time."""
SHORT, LONGEST = 5.0, 100.0
"""Length of a run when its page is opened, and its largest length when its file is read, s."""
MILLI = 1e3


def blocks(language: str) -> list[str]:
    """Code blocks of the chapter in a language."""
    return re.findall(rf"```{language}\n(.*?)```", CHAPTER.read_text(encoding="utf-8"), re.DOTALL)


@contextmanager
def hub(folder: Path) -> Iterator[psutil.Process]:
    """The chapter's hub, installed and run in a folder; the installation stays there."""
    configuration = "".join(blocks("python"))
    if os.name == "posix" and os.geteuid() == 0:
        configuration += 'c.Spawner.args = ["--allow-root"]\n'  # Jupyter itself refuses root without this.
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


def home_of(name: str) -> Path:
    """Where the chapter's hub puts a student's files."""
    [template] = re.findall(r'home_dir_template = "(.+)"', "".join(blocks("python")))
    return Path(template.format(username=name))


def sign_in(page: Page, name: str) -> None:
    """Sign in on the hub's page, which then opens the page that was requested."""
    page.locator("#username_input").fill(name)
    page.locator("#password_input").fill(PASSWORD)
    page.locator("#login_submit").click()


def log_in(page: Page, name: str) -> None:
    """Log in, and wait for the launcher of the student's own server."""
    page.goto(HUB)
    sign_in(page, name)
    page.locator(".jp-LauncherCard", has_text="flexlab").first.wait_for()


class Student:
    """A student with a browser window that has its own cookies; records the errors of its pages."""

    def __init__(self, browser: Browser, name: str, drawn: bool):
        self.name, self.errors, self.redirects = name, [], []
        self.note = f"by {name} at {time.time():.0f}"  # The homes may hold runs of an earlier try.
        self.window = open_window(browser, 1280, 800, drawn=drawn)
        self.window.on("response", self.note_redirect)
        self.window.on("requestfailed", self.note_failure)
        self.window.set_default_timeout(MILLI * PATIENCE)
        self.jupyter = self.window.new_page()
        log_in(self.jupyter, name)
        say(name, "is in the launcher")

    def note_redirect(self, answer: Response) -> None:
        """Note where flexlab's pages redirect the browser: the header's text, and the address that it leads to."""
        if f"/user/{self.name}/flexlab" in answer.url and "location" in answer.headers:
            self.redirects.append((said := answer.headers["location"], urljoin(answer.url, said)))

    def note_error(self, error: str) -> None:
        """Note an error, unless it says that rerun's viewer was kept from looking for updates or reporting its use."""
        if "Content Security Policy" not in error and not ("Failed to fetch" in error and "re_viewer.js" in error):
            self.errors.append(error)

    def note_failure(self, request: Request) -> None:
        """Note a failed request to the hub, unless it was aborted because its page was closed."""
        if request.url.startswith(HUB) and request.failure != "net::ERR_ABORTED":
            self.errors.append(f"{request.url}: {request.failure}")

    def open_lab(self) -> None:
        """Open the lab from the launcher; its page may still be waiting for the engine."""
        with self.window.expect_page() as opened:
            self.jupyter.locator(".jp-LauncherCard", has_text="flexlab").first.click()
        self.lab = opened.value
        self.lab.on("pageerror", lambda error: self.note_error(f"{error} {error.stack}"))

    def use_lab(self, folder: Path) -> None:
        """Check that the scene is drawn and that a slider has an effect."""
        self.lab.wait_for_function(SCENE)
        self.lab.on("console", lambda said: said.type == "error" and self.note_error(said.text))
        assert self.lab.url.partition("?")[0] == f"{HUB}/user/{self.name}/flexlab/lab/", self.lab.url
        slider = self.lab.get_by_role("slider", name="Bending stiffness EI", exact=True)
        slider.focus()
        slider.press("Home")
        self.lab.wait_for_function("() => document.body.innerText.includes('first beam frequency')")
        self.lab.wait_for_function("() => /4\\.4\\d Hz/.test(document.body.innerText)")  # EI = 1 N·m²
        self.lab.screenshot(path=folder / f"{self.name}-lab.png")
        say(self.name, "moved the beam's stiffness from 45 Hz to 4.5 Hz")

    def keep_run(self, folder: Path) -> None:
        """Check that the page of a new run draws it, marks it as kept, and offers its file."""
        # The first run went on while the labs compiled, and jupyter-server-proxy forwards no file above 100 MB.
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
        own = home_of(self.name) / "flexlab" / "logs" / download.value.suggested_filename
        assert own.is_file(), f"{own}: runs lie in the home of the student"
        self.lab.screenshot(path=folder / f"{self.name}-run.png")
        time_span = read_recording(file).samples.time
        assert time_span[-1] < LONGEST, f"{time_span[-1]} s: not the run that began anew"
        say(self.name, f"sees the run in the viewer and has its file: {time_span[-1]:.1f} s of {own}")
        self.lab.get_by_role("link", name="Runs", exact=True).click()  # The next student's viewer needs the processor.
        self.lab.locator("#runs").wait_for()

    def return_to_lab(self) -> None:
        """Return to the lab from the list of runs."""
        self.lab.get_by_role("link", name="Lab", exact=True).click()
        self.lab.wait_for_function(SCENE)

    def log_out(self) -> None:
        """Log out, and check that the lab, which goes on running, shows nothing to the next person."""
        self.lab.close()
        self.jupyter.goto(f"{HUB}/hub/logout")
        page = self.window.new_page()
        page.goto(f"{HUB}/user/{self.name}/flexlab/runs")
        page.locator("#login_submit").wait_for()
        assert self.note not in page.content()
        page.close()

    def stop_server(self) -> None:
        """Stop the student's server on the hub's page."""
        self.jupyter.goto(f"{HUB}/hub/home")
        self.jupyter.locator("#stop").click()
        self.jupyter.locator("#stop").wait_for(state="hidden")

    def has_runs(self) -> None:
        """Check that the list of runs shows the kept run again."""
        self.lab = self.window.new_page()
        self.lab.goto(f"{HUB}/user/{self.name}/flexlab/runs")
        self.lab.locator("#runs tr", has_text=self.note).locator(".kept").wait_for()


def check_redirects(student: Student) -> None:
    """Check that redirects lead to the own lab or the hub's login; jupyter-server-proxy adds its prefix to some itself."""
    own, login = f"{HUB}/user/{student.name}/", f"{HUB}/hub/"
    assert any(to.startswith(f"{own}flexlab/runs/") for _, to in student.redirects), (
        "saving a note leads back to the run"
    )
    away = [to for _, to in student.redirects if not to.startswith((f"{own}flexlab/", f"{own}oauth_callback", login))]
    assert not away, away
    twice = [said for said, _ in student.redirects if said.count(f"/user/{student.name}/") > 1 and login not in said]
    assert not twice, twice
    say(f"{student.name} was redirected to", *sorted({to.partition("?")[0] for _, to in student.redirects}))


def say(*words: str) -> None:
    """Print a line that begins with the time since the start, s."""
    print(f"{time.monotonic() - BEGUN:6.1f}", *words, flush=True)


BEGUN = time.monotonic()


def listeners(process: psutil.Process) -> set[str]:
    """Addresses on which the hub and the processes that it started listen."""
    family = [process, *process.children(recursive=True)]
    plugs = [plug for each in family for plug in each.net_connections("inet") if plug.status == psutil.CONN_LISTEN]
    return {plug.laddr.ip for plug in plugs}


def teach(browser: Browser, students: list[Student], folder: Path) -> None:
    """Check that the teacher sees all labs, sends a preset, pauses a lab, and joins it without a question from the hub."""
    window = open_window(browser, 1280, 800, drawn=True)
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
    title = load_preset("stiff-beam").title
    for each in students:
        tiles.filter(has_text=each.name).locator(".lab-title", has_text=title).wait_for()
        each.lab.get_by_text(title, exact=True).first.wait_for()
    paused = students[1]
    tile = tiles.filter(has_text=paused.name)
    tile.get_by_role("button", name="Pause").click()
    tile.locator("[data-field=state]", has_text="paused").wait_for()
    paused.lab.get_by_text("Paused", exact=True).wait_for()
    with window.expect_page() as joined:
        tile.get_by_role("link", name="Join").click()
    page.screenshot(path=folder / "teacher.png")
    joined.value.wait_for_function(SCENE)
    assert joined.value.url.startswith(f"{HUB}/user/{paused.name}/flexlab/lab/"), joined.value.url
    joined.value.get_by_text("Paused", exact=True).wait_for()
    joined.value.screenshot(path=folder / "teacher-joined.png")
    window.close()
    say("the teacher sees all labs, sends a preset, pauses and joins")


def refuse(browser: Browser, folder: Path) -> None:
    """Check that a student who opens the teacher's page is told why it is not shown."""
    window = open_window(browser, 1280, 800)
    page = window.new_page()
    page.goto(f"{HUB}/services/flexlab/teacher")
    with page.expect_response(lambda answer: "oauth2/authorize" in answer.url) as refused:
        sign_in(page, STUDENTS[0])
    assert refused.value.status == 403, refused.value.status
    sentence = page.locator(".error p", has_text="You do not have permission to access")
    sentence.wait_for()
    page.screenshot(path=folder / "refused.png")
    say("a student is refused at the teacher's page:", sentence.inner_text())
    window.close()


def main(folder: Path) -> None:
    """Run all checks; raise if something is not as the chapter says."""
    with ExitStack() as ending:
        running = ending.enter_context(hub(folder))
        say("the hub runs")
        playwright = ending.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=find_browser(), args=SOFTWARE_RENDERING)
        students = [Student(browser, name, drawn=name == STUDENTS[0]) for name in STUDENTS]
        for each in students:
            each.open_lab()
        for each in students:
            each.use_lab(folder)
        found = listeners(running)
        assert found <= {"127.0.0.1", "::1"}, found
        say("all listen on", *found, "only")
        for each in students:
            each.keep_run(folder)
            for other in set(STUDENTS) - {each.name}:
                answer = each.window.request.get(f"{HUB}/user/{other}/flexlab/runs")
                assert answer.status in (403, 404), answer.status
        say("nobody gets into a neighbour's lab")
        for each in students:
            each.return_to_lab()
        teach(browser, students, folder)
        refuse(browser, folder)
        for each in students:
            each.log_out()
            log_in(each.jupyter, each.name)
            each.has_runs()
        say("after logging out nobody sees a lab; after logging in again all have their runs")
        for each in students:
            each.stop_server()
            each.log_out()
            log_in(each.jupyter, each.name)
            each.has_runs()
            assert each.errors == [], each.errors
            check_redirects(each)
        say("so it is after their servers were stopped")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
