"""`flexlab`: the lab in the browser."""

import os
import secrets
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, output
from flexlab.cli.options import LOGS, Law, Logs, PathChoice, Preset
from flexlab.cli.showing import ending, open_browser, wait_for
from flexlab.cli.warmup import loading

if TYPE_CHECKING:
    from flexlab.server.front_server import FrontServer
    from flexlab.server.settings import Settings


def command(
    preset: Preset = "paper",
    law: Law = None,
    path: PathChoice = None,
    host: Annotated[
        str,
        tyro.conf.arg(
            metavar="ADDRESS",
            help="Who may look: this machine only, 0.0.0.0 for all who have the token, or a proxy (unix:FILE).",
        ),
    ] = "127.0.0.1",
    port: Annotated[int, tyro.conf.arg(metavar="PORT", help="The page's port; 0 takes any free one.")] = 8080,
    base_url: Annotated[
        str,
        tyro.conf.arg(
            metavar="/PATH", help="What a proxy has before every address, as a JupyterHub does.", help_behavior_hint=""
        ),
    ] = "",
    no_browser: Annotated[
        bool, tyro.conf.arg(help="Only serve the page; do not open a browser.", help_behavior_hint="")
    ] = False,
    rerun: Annotated[
        bool, tyro.conf.arg(help="Serve the data live to a rerun viewer as well.", help_behavior_hint="")
    ] = False,
    logs: Logs = LOGS,
    private: Annotated[
        bool,
        tyro.conf.arg(help="Give each visitor a lab of their own; otherwise all share one.", help_behavior_hint=""),
    ] = False,
    max_sessions: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Most private labs at once; as many as memory and cores take if left out.",
            help_behavior_hint="",
        ),
    ] = None,
    max_per_address: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Most private labs of one address; one less than in all if left out.",
            help_behavior_hint="",
        ),
    ] = None,
    idle_time: Annotated[
        float, tyro.conf.arg(metavar="S", help="A private lab closes after so long without an open page, s.")
    ] = 600.0,
    token: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="WORD", help="The word that opens the server to others; made up if left out.", help_behavior_hint=""
        ),
    ] = None,
    teacher_token: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="WORD",
            help="The word that opens all labs and all runs; made up if left out.",
            help_behavior_hint="",
        ),
    ] = None,
    quota: Annotated[
        float | None,
        tyro.conf.arg(
            metavar="MB", help="Record no more for a visitor whose runs take so much.", help_behavior_hint=""
        ),
    ] = None,
    max_size: Annotated[
        float | None,
        tyro.conf.arg(
            metavar="GB",
            help="Delete the oldest runs, but never kept ones, while all are larger.",
            help_behavior_hint="",
        ),
    ] = None,
    max_age: Annotated[
        float | None,
        tyro.conf.arg(metavar="DAYS", help="Delete older runs, but never kept ones.", help_behavior_hint=""),
    ] = None,
) -> None:
    """Open the lab: two arms carry a flexible beam, live in your browser, every run recorded."""
    if private:
        _read_ahead()
    with loading():
        from flexlab.cli.options import chosen_scenarios
        from flexlab.cli.warmup import compiling_the_rest, warm_up
        from flexlab.own.files import LAW_FILES, PATH_FILES
        from flexlab.own.hosts import run_apart
        from flexlab.recording.store.run_files import check_folder
        from flexlab.server.front_server import open_front_server
        from flexlab.server.settings import SECRET_BYTES, Settings, capacity
        from flexlab.sockets import listen

    run_apart()
    for problem in [*LAW_FILES.add_all(), *PATH_FILES.add_all()]:
        complain(problem)
    [(name, scenario)] = chosen_scenarios([preset], (), law, None, path)
    most_bytes = None if max_size is None else max_size * GIGABYTE
    settings = Settings(
        logs,
        host,
        port,
        token,
        private,
        capacity().labs if max_sessions is None else max_sessions,
        idle_time,
        most_bytes=most_bytes,
        most_days=max_age,
        max_per_address=max_per_address,
        teacher_token=teacher_token,
        most_bytes_per_visitor=None if quota is None else quota * MEGABYTE,
        live=rerun,
        base_url=base_url,
        class_service="" if private else os.environ.get("FLEXLAB_CLASS", ""),
    )
    if not settings.is_local and token is None:
        # Made up here, so that a page opened while compiling can turn into the lab.
        settings = replace(settings, token=secrets.token_urlsafe(SECRET_BYTES))
    # Before compiling, which takes long.
    check_folder(logs)
    listen(host, port).close()
    shown: list[str] = []
    has_browser = not (no_browser or settings.is_socket)
    known = port or settings.is_socket  # Else nobody knows yet where the lab will be.
    warm_up(scenario, meanwhile=_waiting_page(settings, has_browser, shown) if known else None)
    with ending() as ended, ExitStack() as closing:
        front_server = closing.enter_context(open_front_server(settings, scenario, name, on_problem=complain))
        _welcome(front_server)
        closing.enter_context(compiling_the_rest())
        if has_browser and not shown:
            open_browser(front_server.lab_url)
        wait_for(ended)
    last = front_server.close()
    output().print()
    if last is not None:
        review = "flexlab review" if logs == LOGS else f"flexlab review {last}"
        output().print(f"The last run is in {last}. Look at it with: {review}", soft_wrap=True)


def _read_ahead() -> None:
    """Begin to read the program of labs, beside what this process reads itself: the first visitor waits for both."""
    from flexlab.compiled import is_warm
    from flexlab.server.child_processes import prepare_lab_processes

    # Where the engine is yet to be compiled, the two would do that at once, each for itself.
    if is_warm():
        prepare_lab_processes()


@contextmanager
def _waiting_page(settings: "Settings", browser: bool, shown: list[str]) -> Generator[None, None, None]:
    """A page that says what takes so long, where the lab will be; notes in `shown` that a browser shows it."""
    from flexlab.cli.showing import WaitingPage

    with WaitingPage(settings.host, settings.port) as page:
        if browser:
            shown.append(f"{page.url}/lab/" + (f"?token={settings.token}" if settings.token else ""))
            open_browser(shown[0])
        yield


MEGABYTE, GIGABYTE = 1e6, 1e9


def _welcome(front_server: "FrontServer") -> None:
    from flexlab.server.settings import capacity

    settings = front_server.settings
    lines = [f"The lab is open at {front_server.lab_url}", f"Start page, with all runs: {front_server.url}"]
    if settings.private:
        lines.append(
            f"Private labs: at most {settings.max_sessions} at once, {settings.labs_per_address} of one address "
            f"({capacity().text}); who comes later waits in line."
        )
    if settings.private or not settings.is_local:
        lines.append(f"All labs at a glance, for the teacher: {front_server.teacher_url}")
    # Where each has a lab of their own, they first say who they are.
    addresses = front_server.outside_addresses("/" if settings.private else "/lab/")
    lines += [f"From other machines: {address}" for address in addresses]
    if not settings.is_local and not addresses:
        lines.append("From other machines: the same with this machine's name instead of 127.0.0.1.")
    if settings.live and settings.private:
        lines.append("Live data of each private lab: by the button Live data in its page.")
    elif settings.live:
        source = front_server.live_source
        lines += [f"Live data in your browser: {front_server.address('/live')}", f"or in rerun itself: rerun {source}"]
    if settings.most_bytes is not None or settings.most_days is not None:
        lines.append("Runs over the limits are deleted, oldest first; never those that are kept.")
    lines.append(f"Runs are recorded in {settings.logs}. Ctrl-C ends the lab.")
    for line in lines:
        output().print(line, style="bold" if line is lines[0] else "", soft_wrap=True)
    if addresses:
        from rich.text import Text

        from flexlab.server.settings import terminal_code

        output().print(Text.from_ansi(terminal_code(addresses[0])))
