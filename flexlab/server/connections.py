"""Limits on connections: idle ones make room for others, slow requests are closed, accepting survives a lack of handles."""

import asyncio
import contextlib
import errno
import socket
import time
from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web
from aiohttp.web_protocol import RequestPayloadError

from flexlab.server.limits import network_of
from flexlab.sockets import raise_handles
from flexlab.text import limited

HEAD_TIME = 10.0
"""Most seconds from connecting, or from the first byte of a further request, to the end of the request's head."""
KEPT_OPEN = 30.0
"""Seconds that a connection may be idle between two requests."""
BODY_TIME, BODY_RATE = 10.0, 5_000.0
"""Seconds after which a body must have arrived at this average rate or faster, bytes/s: modems are faster."""
MOST_RESTING, MOST_RESTING_PER_ADDRESS = 400, 240
"""Most idle connections, of all and of one address. Beyond it the oldest are closed, first those without an accepted request.
A class of 40 behind one address has 240, as browsers open six each."""
RESTING_SHARE = 4
"""Idle connections may take one in this many of the process's handles."""
MOST_OF_ADDRESS, ADDRESS_SHARE = 1000, 2
"""Most connections of one address, idle or not; they may take one in `ADDRESS_SHARE` handles, as others must get in too."""
STALLED_TIME = 60.0
"""Seconds after which a visitor who reads nothing of what is sent is cut off, on Linux; else the connection would stay."""
LOOK = 1.0
"""Seconds between two checks for slow connections."""
PAUSE = 0.2
"""Pause in accepting, s, when the system has no handle left."""
OUT_OF_HANDLES = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

MALFORMED = "This request is malformed: send it again."

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

log = limited(__name__)
limited("aiohttp.server")


class Visit(web.RequestHandler):
    """One connection, with the times that show whether it is too slow."""

    def __init__(self, connections: "Connections", manager: web.Server, loop: asyncio.AbstractEventLoop):
        super().__init__(manager, loop=loop, access_log=None, keepalive_timeout=KEPT_OPEN, lingering_time=2.0)  # pyright: ignore[reportArgumentType]
        self.connections, self.address = connections, ""
        self.began, self.received, self.body_before = time.monotonic(), 0, 0
        self.busy, self.known = False, False
        self.request: web.BaseRequest | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take up a new connection."""
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")
        self.address = network_of(str(peer[0])) if peer else ""
        self.connections.add(self)

    def connection_lost(self, exc: BaseException | None) -> None:
        """Forget the closed connection."""
        self.connections.remove(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take a piece of a request."""
        if not self.busy and self.known and not self.received:
            self.began = time.monotonic()
        self.received += len(data)
        super().data_received(data)

    def eof_received(self) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Whether to answer a visitor who sends no more. Within a body, or once an answer has begun, it means that they left."""
        begun = self.request is not None and self.request.writer.output_size > 0
        # What came then is the rest of an answered form, or a piece of a head: aiohttp waits for a request.
        nothing = self._waiter is not None and not self._messages
        if begun or nothing or self._awaits_body() or not (self.received or self.request):
            return False
        self.close()
        return True

    def starts(self, request: web.BaseRequest) -> None:
        """Note that a request has been read up to its body."""
        self.busy, self.request, self.began, self.body_before = True, request, time.monotonic(), self.received

    def ends(self, is_known: bool) -> None:
        """Note that the request's answer is known, and only has to be sent. `is_known`: its sender was let in."""
        self.busy, self.began, self.received = False, time.monotonic(), 0
        self.known = self.known or is_known

    async def finish_response(
        self, request: web.BaseRequest, resp: web.StreamResponse, start_time: float | None
    ) -> tuple[web.StreamResponse, bool]:
        """Send an answer; a file is opened only now."""
        try:
            return await super().finish_response(request, resp, start_time)
        finally:
            self.request = None

    def is_too_slow(self, now: float) -> bool:
        """Whether the request has used up its time."""
        if not self.busy:
            # Between two requests, aiohttp itself limits the idle time.
            return now - self.began > HEAD_TIME and (not self.known or self.received > 0)
        time_taken = now - self.began
        return (
            self._awaits_body() and time_taken > BODY_TIME and self.received - self.body_before < BODY_RATE * time_taken
        )

    def _awaits_body(self) -> bool:
        """Whether a part of the request's body has not come yet."""
        return self.request is not None and not self.request.content.is_eof()

    def handle_error(
        self, request: web.BaseRequest, status: int = 500, exc: BaseException | None = None, message: str | None = None
    ) -> web.StreamResponse:
        """Refuse a malformed request in one line that quotes none of it: its head may hold a token."""
        if status >= 500:
            return super().handle_error(request, status, exc, message)
        self._tell_refused(exc)
        if request.writer.output_size > 0:
            raise ConnectionError("Part of an answer has been sent already.")
        answer = web.Response(status=status, text=MALFORMED)
        answer.force_close()
        return answer

    def log_exception(self, *words: Any, **more: Any) -> None:
        """Log one line if a visitor stops reading a file or sends a malformed body; log nothing if they leave.

        aiohttp treats all three as defects.
        """
        reason = more.get("exc_info")
        if isinstance(reason, TimeoutError):
            log.warning("Cut off %s, who read nothing of what was sent for %g s.", self.address, STALLED_TIME)
        elif isinstance(reason, RequestPayloadError):
            self._tell_refused(reason)
        elif not isinstance(reason, ConnectionError):  # The visitor has left meanwhile.
            super().log_exception(*words, **more)

    def _tell_refused(self, reason: BaseException | None) -> None:
        log.warning("Refused a malformed request from %s (%s).", self.address, type(reason).__name__)

    def cut(self) -> None:
        """Close the connection at once."""
        if self.transport is not None:
            self.transport.abort()


class Connections:
    """All connections to one server, and the loop that accepts them. For its event loop only."""

    def __init__(self, plug: socket.socket, manager: web.Server):
        self._plug, self._manager = plug, manager
        self._open: dict[Visit, None] = {}
        handles = raise_handles()
        self._most = min(MOST_RESTING, handles // RESTING_SHARE)
        self._most_of_address = min(MOST_OF_ADDRESS, handles // ADDRESS_SHARE)
        self._tasks = [asyncio.create_task(self._accept()), asyncio.create_task(self._look())]

    def add(self, visit: Visit) -> None:
        """Add a new connection; others may be closed to make room."""
        self._open[visit] = None
        resting = [other for other in self._open if not other.busy]
        if len(resting) > self._most:
            self._make_room(resting)
        same = [other for other in resting if other.address == visit.address]
        if len(same) > MOST_RESTING_PER_ADDRESS:
            self._make_room(same)
        if sum(other.address == visit.address for other in self._open) > self._most_of_address:
            log.warning("Too many connections are open from %s: closed its newest.", visit.address)
            self.remove(visit)
            visit.cut()

    def remove(self, visit: Visit) -> None:
        """Remove a closed connection."""
        self._open.pop(visit, None)

    async def close(self) -> None:
        """Stop accepting connections."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._plug.close()

    def _make_room(self, visits: list[Visit]) -> None:
        oldest = min(visits, key=lambda visit: (visit.known, visit.began))
        log.warning("Too many connections are idle: closed the oldest, from %s.", oldest.address)
        self.remove(oldest)
        oldest.cut()

    async def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                plug, _ = await loop.sock_accept(self._plug)
            except OSError as error:
                if error.errno in OUT_OF_HANDLES:
                    log.error("No connection can be accepted (%s): closing an idle one.", error.strerror)
                    resting = [visit for visit in self._open if not visit.busy]
                    if resting:
                        self._make_room(resting)
                    await asyncio.sleep(PAUSE)
                continue
            plug.setblocking(False)
            with contextlib.suppress(OSError):
                if plug.family in (socket.AF_INET, socket.AF_INET6):  # Not on a Unix socket.
                    plug.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    if hasattr(socket, "TCP_USER_TIMEOUT"):
                        plug.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1e3 * STALLED_TIME))
                await loop.connect_accepted_socket(lambda: Visit(self, self._manager, loop), plug)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(LOOK)
            now = time.monotonic()
            for visit in [visit for visit in self._open if visit.is_too_slow(now)]:
                log.warning("Closed a connection from %s: its request took too long to arrive.", visit.address)
                visit.cut()


@web.middleware
async def watch_patience(request: web.Request, handler: Handler) -> web.StreamResponse:
    """A middleware outside all checks: tells the connection when a request begins and ends."""
    visit = request.protocol
    if not isinstance(visit, Visit):
        return await handler(request)
    visit.starts(request)
    is_known = False
    try:
        response = await handler(request)
        is_known = response.status != 401
        return response
    except web.HTTPException as error:
        is_known = error.status != 401
        raise
    finally:
        visit.ends(is_known)
