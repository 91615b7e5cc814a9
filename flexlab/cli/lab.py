"""`flexlab`: the lab in the browser."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import tyro

from flexlab.cli.console import complain, output
from flexlab.cli.options import LOGS, Logs, Preset
from flexlab.cli.showing import ending, open_browser, wait_for

if TYPE_CHECKING:
    from flexlab.recording.live import LiveHub
    from flexlab.recording.writer import Recorder


def command(
    preset: Preset = "paper",
    host: Annotated[
        str, tyro.conf.arg(metavar="ADDRESS", help="Who may look: this machine only, or 0.0.0.0 for all.")
    ] = "127.0.0.1",
    port: Annotated[int, tyro.conf.arg(metavar="PORT", help="The page's port; 0 takes any free one.")] = 8080,
    no_browser: Annotated[
        bool, tyro.conf.arg(help="Only serve the page; do not open a browser.", help_behavior_hint="")
    ] = False,
    rerun: Annotated[
        bool, tyro.conf.arg(help="Serve the data live to a rerun viewer as well.", help_behavior_hint="")
    ] = False,
    logs: Logs = LOGS,
) -> None:
    """Open the lab: two arms carry a flexible beam, live in your browser, every run recorded.

    Other commands, each with a --help of its own:

      flexlab run PRESET       simulate without a screen, record, print a summary
      flexlab review [FILE]    open a recording, the newest by default
      flexlab presets          list the presets and what to watch in each
      flexlab bench            measure speed and accuracy on this machine
    """
    from flexlab.presets import find_scenario

    name, scenario = find_scenario(preset)
    from flexlab.cli.warmup import warm_up
    from flexlab.lab.server import _check_free as check_free
    from flexlab.lab.session import Session
    from flexlab.recording.run_files import check_folder
    from flexlab.recording.writer import Recorder

    # Before compiling, and before a recorder makes a file for a lab that cannot open.
    check_folder(logs)
    check_free(host, port)
    shown: list[str] = []
    warm_up(scenario, meanwhile=_waiting_page(host, port, not no_browser, shown) if port else None)
    with ending() as ended, ExitStack() as closing:
        live = _serve_live(closing) if rerun else None
        recorder = Recorder(logs, live.hub if live else None, on_problem=complain)
        closing.callback(recorder.close)
        session = Session(
            scenario, name, consumers=[recorder], host=host, port=port, recording=lambda: recording_text(recorder)
        )
        closing.callback(_quietly, session.stop)
        _quietly(session.start)
        _welcome(session.url, live, logs)
        if not no_browser and not shown:
            open_browser(session.url)
        wait_for(ended)
        last = recorder.path
    output().print()
    if last is not None:
        output().print(f"The last run is in {last}. Look at it with: flexlab review", markup=False, soft_wrap=True)


@contextmanager
def _waiting_page(host: str, port: int, browser: bool, shown: list[str]) -> Iterator[None]:
    """A page that says what takes so long, where the lab will be; notes in `shown` that a browser shows it."""
    from flexlab.cli.waiting_page import WaitingPage

    try:
        page = WaitingPage(host, port)
    except OSError:
        # An address that only the lab's own server understands: then the terminal alone must do.
        yield
        return
    with page:
        if browser:
            open_browser(page.url)
            shown.append(page.url)
        yield


class Live(NamedTuple):
    """Where the data of all runs can be watched in rerun while the lab runs."""

    hub: "LiveHub"
    page: str
    """Of the web viewer."""


def _serve_live(closing: ExitStack) -> Live:
    """Serve live data and a web viewer for it until `closing` closes. Raises `RecordingError` if that is not possible."""
    from flexlab.recording.live import LiveHub
    from flexlab.recording.web_viewer import ViewerServer, viewer_link

    viewer = ViewerServer()
    closing.callback(viewer.close)
    hub = LiveHub()
    closing.callback(hub.close)
    return Live(hub, viewer_link(viewer.page, hub.url))


def recording_text(recorder: "Recorder") -> str:
    """What the panel says about the recording."""
    if recorder.problem is not None:
        return recorder.problem
    return "" if recorder.path is None else f"Recording to {recorder.path.name}"


def _welcome(url: str, live: Live | None, logs: Path) -> None:
    lines = [f"The lab is open at {url}"]
    if live is not None:
        lines += [f"Live data in your browser: {live.page}", f"or in rerun itself: rerun --connect {live.hub.url}"]
    lines.append(f"Runs are recorded in {logs}. Ctrl-C ends the lab.")
    for line in lines:
        output().print(line, style="bold" if line is lines[0] else "", markup=False, soft_wrap=True)


def _quietly(action: Callable[[], None]) -> None:
    """Do it while viser's own banner is kept back: what matters of it is said in this lab's words."""
    with redirect_stdout(StringIO()):
        action()
