"""`flexlab`: the lab in the browser."""

import signal
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, output
from flexlab.cli.options import LOGS, Logs, Preset

if TYPE_CHECKING:
    from flexlab.recording.live import LiveHub
    from flexlab.recording.writer import Recorder
    from flexlab.scenario import Scenario

LOOK = 0.5
"""s between two looks at whether to end: on Windows, Ctrl-C cannot interrupt a wait without end."""


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
    from flexlab.recording.run_files import check_folder

    check_folder(logs)
    warm_up(scenario)
    with ending() as ended:
        _open(scenario, name, host, port, logs, rerun, not no_browser, ended)


def _open(
    scenario: "Scenario",
    name: str,
    host: str,
    port: int,
    logs: Path,
    rerun: bool,
    browser: bool,
    ended: threading.Event,
) -> None:
    """Serve the lab until `ended`. Raises `LabError` or `RecordingError` if it cannot be started."""
    from flexlab.lab.session import Session
    from flexlab.recording.live import LiveHub
    from flexlab.recording.writer import Recorder

    hub = LiveHub() if rerun else None
    recorder = Recorder(logs, hub, on_problem=complain)
    session = Session(
        scenario, name, consumers=[recorder], host=host, port=port, recording=lambda: recording_text(recorder)
    )
    last = None
    try:
        with session:
            _welcome(session.url, hub, logs)
            if browser:
                webbrowser.open(session.url)
            while not ended.wait(LOOK):
                last = recorder.path or last
            last = recorder.path or last
    finally:
        recorder.close()
        if hub is not None:
            hub.close()
    output().print()
    if last is not None and last.exists():
        output().print(f"The last run is in {last}. Look at it with: flexlab review", markup=False, soft_wrap=True)


def recording_text(recorder: "Recorder") -> str:
    """What the panel says about the recording."""
    if recorder.problem is not None:
        return recorder.problem
    return "" if recorder.path is None else f"Recording to {recorder.path.name}"


def _welcome(url: str, hub: "LiveHub | None", logs: Path) -> None:
    console = output()
    console.print(f"The lab is open at {url}", style="bold", markup=False, soft_wrap=True)
    if hub is not None:
        console.print(f"Live data for a rerun viewer: {hub.url}", markup=False, soft_wrap=True)
    console.print(f"Runs are recorded in {logs}. Ctrl-C ends the lab.", markup=False, soft_wrap=True)


@contextmanager
def ending() -> Iterator[threading.Event]:
    """An event that Ctrl-C, a closed terminal or a polite kill sets, so that recordings are always closed."""
    ended = threading.Event()
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {name: signal.signal(getattr(signal, name), lambda *_: ended.set()) for name in names}
    try:
        yield ended
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
