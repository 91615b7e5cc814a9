"""Opens and closes the front server, a web server on its own thread with the labs behind it.

The server locks its temporary folder, so that a later server can recognize and remove the folders of killed ones.
"""

import asyncio
import contextlib
import logging
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import aiohttp
from aiohttp import web

from flexlab.assets import web_assets_folder
from flexlab.errors import FlexlabError, LabError
from flexlab.files import HAS_LOCKS, check_ordinary, lock
from flexlab.recording.store.run_files import check_folder, removable_runs, remove_run
from flexlab.registry import modules_in
from flexlab.scenario import Scenario
from flexlab.server.auth import LARGEST_BODY, LIVE, add_headers, answer_in_sentences, check, recording_address
from flexlab.server.base_url import put_before, take_off
from flexlab.server.connections import Connections, watch_patience
from flexlab.server.labs import Choice, LabProvider, Order
from flexlab.server.labs.hub_labs import tell_class
from flexlab.server.labs.per_visitor import PrivateLabs
from flexlab.server.labs.recorded_lab import SharedLab
from flexlab.server.pages import DRAWING_POLICY, catalogues
from flexlab.server.pages.teacher_page import kept_rules
from flexlab.server.proxy import inside_connector
from flexlab.server.settings import GIGABYTE, Settings, secret_word
from flexlab.server.visitors import CONTEXT, Context, greet
from flexlab.sockets import listen

PREFIX = "flexlab-server-"
LOCK = "in-use"
"""The folder's lock file. Its lock ends with the server; a process's number could belong to another process by then."""
YOUNG = 60.0
"""Age, s, up to which a folder without a lock file may be one that is just being made."""
CLOSING_TIME = 1.0
"""Seconds that open pages get when the server closes: a lab's page never ends by itself."""
MOST_THREADS = 32
"""Threads that wait for disks and processes, plus one for each private lab, so that labs opening together do not delay pages."""
LOOK = 60.0
"""Seconds between two checks of the limits on runs."""
log = logging.getLogger(__name__)


@contextlib.contextmanager
def temporary_folder() -> Generator[Path]:
    """A new temporary folder, locked until the end of the block, which removes it with its files."""
    remove_left()
    folder = Path(tempfile.mkdtemp(prefix=PREFIX))
    try:
        with (folder / LOCK).open("wb") as file:
            lock(file, attempts=10)  # A server that starts may hold the lock for a moment.
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_left() -> None:
    """Remove the folders of servers that no longer run."""
    if not HAS_LOCKS:
        return
    with contextlib.suppress(OSError):
        for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                if folder.is_dir() and not folder.is_symlink() and _is_left(folder):
                    shutil.rmtree(folder, ignore_errors=True)


def _is_left(folder: Path) -> bool:
    """Whether no server holds the folder. Raises OSError for another user's folder."""
    try:
        check_ordinary(folder / LOCK)  # Another user's pipe would hold the start up.
        with (folder / LOCK).open("rb") as file:
            lock(file)
    except FileNotFoundError:
        return time.time() - folder.stat().st_mtime > YOUNG
    except BlockingIOError:
        return False
    return True


STATIC = Path(__file__).resolve().parent / "static"
"""Style sheet, scripts and the icon of the server's pages."""
FILES = web.RouteTableDef()
"""Routes of the style sheet, the scripts, the language catalogues and the icon."""
ROUTES = [route for pages in modules_in("flexlab.server.pages") for route in pages.ROUTES]
"""Routes of all pages; of two that match an address, the first one counts."""


def build_app(context: Context, guard: Any = check, routes: Sequence[web.AbstractRouteDef] = ROUTES) -> web.Application:
    """The web application of one server. `guard`: the middleware that decides who comes in; `routes`: its pages."""
    base = context.settings.base_url
    outermost = [put_before(base)] if base else []
    app = web.Application(
        middlewares=[*outermost, watch_patience, answer_in_sentences, guard, greet], client_max_size=LARGEST_BODY
    )
    app[CONTEXT] = context
    app.on_response_prepare.append(add_headers)
    app.add_routes([*routes, *FILES])
    # No listing of folders, no links that lead out of the folder.
    app.router.add_static("/assets/", web_assets_folder())
    return app


@FILES.get("/static/{name}")
async def _static(request: web.Request) -> web.StreamResponse:
    names = await asyncio.to_thread(lambda: {path.name: path for path in (*STATIC.iterdir(), *catalogues().values())})
    if request.match_info["name"] not in names:
        raise web.HTTPNotFound
    headers = {"Cache-Control": "no-cache", "Content-Security-Policy": DRAWING_POLICY}
    return web.FileResponse(names[request.match_info["name"]], headers=headers)


@FILES.get("/favicon.ico")
async def _icon(request: web.Request) -> web.StreamResponse:
    return web.FileResponse(STATIC / "icon.svg")


async def tidy_up(settings: Settings) -> None:
    """Delete runs over the limits, at once and then every minute; returns only if there are no limits."""
    while settings.max_size is not None or settings.max_age is not None:
        await asyncio.to_thread(delete_over_limits, settings)
        await asyncio.sleep(LOOK)


def delete_over_limits(settings: Settings) -> None:
    """Delete runs over the limits, and log their names."""
    most_bytes = None if settings.max_size is None else settings.max_size * GIGABYTE
    try:
        for path in removable_runs(settings.logs, most_bytes, settings.max_age):
            remove_run(path)
            log.warning("Deleted %s: it was over the limits that this lab was started with.", path.name)
    except (FlexlabError, OSError) as error:
        log.warning("Old runs could not be deleted: %s", error)


def _port_of(plug: socket.socket) -> int:
    """The port of a listening socket; 0 for a Unix socket."""
    return 0 if plug.family not in (socket.AF_INET, socket.AF_INET6) else plug.getsockname()[1]


class FrontServer:
    """A front server that is open until `close`. See `open_front_server`."""

    def __init__(
        self,
        settings: Settings,
        places: LabProvider,
        plug: socket.socket,
        app_of: Callable[[Context], web.Application] = build_app,
    ):
        self.settings, self.places, self._plug, self._app_of = settings, places, plug, app_of
        self.port = _port_of(plug)
        """The public port that it listens on."""
        self.temporary_folder: Path
        """Folder for temporary files, removed when the server closes."""
        self.context: Context
        self._opened: Future[None] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: Callable[[], object] = lambda: None
        self._last: Path | None = None
        self._thread = threading.Thread(target=self._run, name="flexlab-server", daemon=True)
        self._thread.start()
        problem = self._opened.exception()
        if problem is not None:
            raise LabError(f"The server did not start ({problem}).") from problem

    @property
    def url(self) -> str:
        """Address of the start page for a browser on this machine, with the token."""
        return self.address("/")

    @property
    def live_source(self) -> str:
        """Address of the shared lab's live data for a rerun viewer on this machine."""
        return self.settings.address(self.port, recording_address(self.context, f"{LIVE}lab"))

    def address(self, path: str = "/", token: str | None = None) -> str:
        """The address of a page on this machine, with a token if the server asks for one."""
        if self.settings.is_socket:
            return f"{self.settings.address(0, path)} behind the proxy of {self.settings.host}"
        return self.settings.address(self.port, path, token=token or self.settings.token)

    def close(self) -> Path | None:
        """Close every page and lab, keep the runs, and return the newest recording. May be called twice."""
        with contextlib.suppress(RuntimeError):  # It is closed already.
            self._end()
        self._thread.join()
        return self._last

    def __enter__(self) -> "FrontServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            with temporary_folder() as self.temporary_folder:
                asyncio.run(self._serve())
        except BaseException as error:
            if self._opened.done():
                log.exception("The server failed.")
            else:
                self._opened.set_exception(error)

    async def _serve(self) -> None:
        self._loop = loop = asyncio.get_running_loop()
        closing = asyncio.Event()
        self._end = partial(loop.call_soon_threadsafe, closing.set)
        threads = MOST_THREADS + self.settings.max_sessions
        loop.set_default_executor(ThreadPoolExecutor(threads, thread_name_prefix="flexlab-server-thread"))
        async with aiohttp.ClientSession(connector=inside_connector()) as inside:
            self.context = context = Context(self.settings, self.port, self.places, inside, self.temporary_folder)
            beside: list[asyncio.Task[Any]] = [
                asyncio.create_task(tidy_up(self.settings)),
                asyncio.create_task(asyncio.to_thread(context.preset_cards.read)),
            ]
            if self.settings.class_service:
                beside.append(asyncio.create_task(tell_class(self.settings.class_service, self.places)))
            runner = web.AppRunner(self._app_of(context), access_log=None, shutdown_timeout=CLOSING_TIME)
            connections: Connections | None = None
            try:
                await runner.setup()
                assert runner.server is not None
                if self.settings.base_url:
                    runner.server.request_factory = take_off(self.settings.base_url, runner.server.request_factory)
                if self.settings.resumes_class:
                    await self.places.rule(await asyncio.to_thread(kept_rules, self.settings.logs))
                connections = Connections(self._plug, runner.server)
                self._opened.set_result(None)
                await closing.wait()
            finally:
                for task in beside:
                    task.cancel()
                if connections is not None:
                    await connections.close()
                # Labs first: their recordings matter more than a visitor's last request.
                self._last = await self.places.close()
                context.tasks.close()
                await runner.cleanup()


def open_front_server(
    settings: Settings, scenario: Scenario, name: str, *, on_problem: Callable[[str], None] | None = None
) -> FrontServer:
    """Listen, start the shared lab (private ones start when visitors come), and serve until the server is closed.

    `scenario`, `name`: what a lab shows first. `on_problem` gets a sentence when recording fails or resumes. Raises `LabError`
    or `RecordingError`, and leaves nothing running, if the server cannot start.
    """
    check_folder(settings.logs)
    with contextlib.ExitStack() as undoing:
        plug = listen(settings.host, settings.port)
        undoing.callback(plug.close)
        choice = Choice(scenario, name)
        # Without the token, which its owner hands out: whoever follows the link is asked for it.
        address = settings.address(_port_of(plug), host=settings.public_host())
        quota = settings.bytes_of_visitor
        order = Order(choice, settings.logs, address, settings.shadows, settings.rerun, secret_word(), quota=quota)
        if settings.private:
            places = PrivateLabs(settings, order)
        else:
            places = SharedLab(order, on_problem)
            undoing.callback(places.laboratory.close)
        server = FrontServer(settings, places, plug)
        undoing.pop_all()
    return server
