"""`flexlab`: the lab in the browser."""

import os
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Annotated

from flexlab.cli.console import complain, output, tell, typed
from flexlab.cli.options import LOGS, Law, Logs, PathChoice, Preset, option
from flexlab.cli.showing import ending, open_browser, wait_for, waiting_page
from flexlab.cli.warmup import loading
from flexlab.errors import LabError

if TYPE_CHECKING:
    from flexlab.server.front_server import FrontServer
    from flexlab.server.settings import Settings


def command(
    preset: Preset = "paper",
    law: Law = None,
    path: PathChoice = None,
    host: Annotated[
        str,
        option(
            "Who may connect: only this machine, with 0.0.0.0 everybody who has the token, or a proxy (unix:FILE).",
            "ADDRESS",
            default=None,
        ),
    ] = "127.0.0.1",
    port: Annotated[int, option("The page's port; 0 takes any free one.", "PORT", default=None)] = 8080,
    base_url: Annotated[str, option("Prefix of every address behind a proxy, as in a JupyterHub.", "/PATH")] = "",
    no_browser: Annotated[bool, option("Only serve the page; do not open a browser.")] = False,
    rerun: Annotated[bool, option("Serve the data live to a rerun viewer as well.")] = False,
    logs: Logs = LOGS,
    private: Annotated[bool, option("Give each visitor a lab of their own; by default all share one.")] = False,
    max_sessions: Annotated[
        int | None, option("Most private labs at once; by default as many as memory and cores allow.", "N")
    ] = None,
    max_per_address: Annotated[
        int | None, option("Most private labs per address; by default one less than in all.", "N")
    ] = None,
    idle_time: Annotated[
        float | None, option("Close a private lab after this time without an open page, s; by default 600.", "S")
    ] = None,
    token: Annotated[
        str | None, option("The word that opens the server to others; by default a random one.", "WORD")
    ] = None,
    teacher_token: Annotated[
        str | None, option("The word that opens all labs and all runs; by default a random one.", "WORD")
    ] = None,
    quota: Annotated[float | None, option("Stop recording for a visitor whose runs take this much.", "MB")] = None,
    max_size: Annotated[
        float | None, option("Delete the oldest runs, but never kept ones, while all together are larger.", "GB")
    ] = None,
    max_age: Annotated[float | None, option("Delete runs older than this, but never kept ones.", "DAYS")] = None,
) -> None:
    """Open the lab: two arms carry a flexible beam, live in your browser, every run recorded."""
    from flexlab.sockets import listen, raise_handles

    raise_handles()
    if private:
        from flexlab.compiled import is_warm
        from flexlab.server.tasks import prepare_lab_processes

        if is_warm():  # Otherwise both processes would compile the engine. The first visitor waits for both.
            prepare_lab_processes()
    else:
        _check_private(max_sessions=max_sessions, max_per_address=max_per_address, idle_time=idle_time, quota=quota)
    with loading():
        from flexlab.cli.options import chosen_scenarios
        from flexlab.cli.warmup import compiling_the_rest, warm_up
        from flexlab.own.files import LAW_FILES, PATH_FILES
        from flexlab.own.hosts import run_apart
        from flexlab.recording.store.run_files import check_folder
        from flexlab.server.front_server import open_front_server
        from flexlab.server.settings import Settings, capacity

    run_apart()
    for problem in [*LAW_FILES.add_all(), *PATH_FILES.add_all()]:
        complain(problem)
    [(name, scenario)] = chosen_scenarios([preset], (), law, None, path)
    most = capacity().labs if max_sessions is None else max_sessions
    idle_time = Settings.idle_time if idle_time is None else idle_time
    settings = Settings(
        logs=logs, host=host, port=port, base_url=base_url, rerun=rerun, private=private, max_sessions=most,
        max_per_address=max_per_address, idle_time=idle_time, token=token, teacher_token=teacher_token, quota=quota,
        max_size=max_size, max_age=max_age, class_service="" if private else os.environ.get("FLEXLAB_CLASS", ""),
    )  # fmt: skip
    # Before compiling, which takes long.
    check_folder(logs)
    listen(settings.host, port).close()
    shown: list[str] = []
    has_browser = not (no_browser or settings.is_socket)
    known = port or settings.is_socket  # Otherwise the lab's address is not known yet.
    warm_up(scenario, meanwhile=_waiting_page(settings, has_browser, shown) if known else None)
    with ending() as ended, ExitStack() as closing:
        front_server = closing.enter_context(open_front_server(settings, scenario, name, on_problem=complain))
        _welcome(front_server)
        closing.enter_context(compiling_the_rest())
        if has_browser and not shown:
            open_browser(front_server.address("/lab/"))
        wait_for(ended)
        output().print("\nClosing: the recordings are being completed.")  # That of a class can take a minute.
    last = front_server.close()
    if last is not None:
        review = "flexlab review" if logs == LOGS else f"flexlab review {typed(last)}"
        tell(f"The last run is in {last}. Look at it with: {review}")


def _check_private(**limits: float | None) -> None:
    """Raise `LabError` for a limit that only private labs have."""
    given = next((name.replace("_", "-") for name, limit in limits.items() if limit is not None), None)
    if given is not None:
        raise LabError(f"--{given} is for private labs: add --private, or leave it out.")


@contextmanager
def _waiting_page(settings: "Settings", browser: bool, shown: list[str]) -> Generator[None, None, None]:
    """Serve a waiting page at the lab's address; append its URL to `shown` if a browser opens it."""
    with waiting_page(settings.host, settings.port):
        if browser:
            shown.append(settings.address(settings.port, "/lab/", token=settings.token))
            open_browser(shown[0])
        yield


def _welcome(front_server: "FrontServer") -> None:
    from flexlab.server.settings import capacity

    settings = front_server.settings
    lines = [f"The lab is open at {front_server.address('/lab/')}", f"Start page, with all runs: {front_server.url}"]
    if settings.private:
        lines.append(
            f"Private labs: at most {settings.max_sessions} at once, {settings.labs_per_address} of one address "
            f"({capacity().text}); later visitors wait in line."
        )
    if settings.has_class:
        teacher = front_server.address("/teacher", settings.teacher_token)
        lines.append(f"All labs at a glance, for the teacher: {teacher}")
    # With private labs, a visitor first gives a name.
    addresses = settings.outside_addresses(front_server.port, "/" if settings.private else "/lab/")
    lines += [f"From other machines: {address}" for address in addresses]
    if not settings.is_local and not addresses:
        lines.append("From other machines: the same with this machine's name instead of 127.0.0.1.")
    if settings.rerun and settings.private:
        lines.append("Live data of each private lab: press Live data on its page.")
    elif settings.rerun:
        source = front_server.live_source
        lines += [f"Live data in your browser: {front_server.address('/live')}", f"or in rerun itself: rerun {source}"]
    if settings.max_size is not None or settings.max_age is not None:
        lines.append("Runs over the limits are deleted, oldest first; never those that are kept.")
    lines.append(f"Runs are recorded in {settings.logs}. Ctrl-C ends the lab.")
    tell(lines[0], style="bold")
    tell(*lines[1:])
    if addresses:
        from rich.text import Text

        from flexlab.server.settings import terminal_code

        output().print(Text.from_ansi(terminal_code(addresses[0])))
