"""Passes a lab's page and its websocket on to visitors. The lab itself is reachable from this machine only."""

import asyncio
import re
import socket
from collections.abc import Coroutine
from typing import Any

import aiohttp
from aiohttp import WSCloseCode, WSMsgType, hdrs, web
from markupsafe import Markup

from flexlab.lab.browser_messages import LARGEST_MESSAGE
from flexlab.lab.viser_internals import SEND_BUFFER, bound_transport
from flexlab.lab.viser_server import SECRET_HEADER
from flexlab.server.labs import Lab
from flexlab.server.pages import language_script
from flexlab.server.visitors import context_of, visitor_of
from flexlab.sockets import LOOPBACK, base_address
from flexlab.text import limited

VISER = re.compile(r"viser-v[\w.+-]{1,40}", re.ASCII)
"""The protocol that viser's page offers, with its version."""
HEARTBEAT = 60.0
"""Seconds between two pings to a visitor; one who does not answer within half of it counts as gone."""
HTTP_PATIENCE = aiohttp.ClientTimeout(total=30.0)
"""Timeout for the lab's page, one file in memory."""

LAB_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' ws://{host} wss://{host} "
    "data: blob:; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
"""viser unpacks its program, part of it compiled, inside the page. The page may connect to this address only."""

ADDITION = Markup("""{language}
<script src="/static/lab.js" data-state="{state}" defer></script>
""")
"""What the server adds to the lab's page: its language, links to other pages, and a notice when the lab is gone."""

log = limited(__name__)


def inside_connector() -> aiohttp.TCPConnector:
    """A connector for any number of connections to labs, with small kernel buffers."""

    def small(address: tuple[Any, ...]) -> socket.socket:
        family, kind, protocol, *_ = address
        plug = socket.socket(family, kind, protocol)
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SEND_BUFFER)
        return plug

    return aiohttp.TCPConnector(limit=0, socket_factory=small)


async def proxy_page(request: web.Request, place: Lab, path: str) -> web.StreamResponse:
    """Return the lab's page or another of its files. Raises `BusyError` for one page too many."""
    if not path:
        # Checked here, because a page without a connection could not say why.
        context_of(request).pages.check(visitor_of(request))
    inside = context_of(request).inside
    try:
        url = f"{base_address(LOOPBACK[0], place.port)}/{path}"
        headers = {hdrs.ACCEPT_ENCODING: "identity", SECRET_HEADER: place.secret}
        async with inside.get(url, headers=headers, timeout=HTTP_PATIENCE) as answer:
            body = await answer.read()
            status, kind = answer.status, answer.content_type
    except (aiohttp.ClientError, TimeoutError):
        raise web.HTTPBadGateway(reason="This lab does not answer: open it again from the start page") from None
    if status != 200:
        raise web.HTTPNotFound
    response = web.Response(body=body, content_type=kind)
    if kind == "text/html":
        response = web.Response(body=_furnish(body, place), content_type=kind, charset="utf-8")
    response.headers["Content-Security-Policy"] = LAB_POLICY.format(host=request.host)
    response.headers["Cache-Control"] = "no-cache"
    # The page is the same for as long as the lab runs, and nearly a megabyte: a reload need not fetch it again.
    response.etag = f"{place.port}-{len(body)}"
    if any(tag.value in ("*", response.etag.value) for tag in request.if_none_match or ()):
        return web.Response(status=304, headers={hdrs.ETAG: response.headers[hdrs.ETAG]})
    return response


def _furnish(body: bytes, place: Lab) -> bytes:
    head, mark, rest = body.rpartition(b"</head>")
    addition = ADDITION.format(language=language_script(), state=f"/state{place.path}")
    return head + addition.encode() + mark + rest if mark else body


async def proxy_websocket(request: web.Request, place: Lab) -> web.StreamResponse:
    """Relay a visitor's live connection to the lab until one side ends it. Raises `BusyError` for one too many."""
    with context_of(request).pages.place(visitor_of(request)):
        return await _relay(request, place)


async def _relay(request: web.Request, place: Lab) -> web.StreamResponse:
    offered = request.headers.getall(hdrs.SEC_WEBSOCKET_PROTOCOL, [])
    if not all(map(VISER.fullmatch, offered)) or len(offered) > 1:  # The lab and aiohttp would log others raw.
        raise web.HTTPBadRequest
    inside = context_of(request).inside
    try:
        # No limit on what the lab sends, and no compression: its data hardly compress and must not wait.
        up = await inside.ws_connect(
            f"ws://{LOOPBACK[0]}:{place.port}{place.path}",
            protocols=offered,
            max_msg_size=0,
            compress=0,
            headers={SECRET_HEADER: place.secret},
        )
    except (aiohttp.ClientError, TimeoutError, OSError):
        raise web.HTTPBadGateway(reason="This lab does not answer: open it again from the start page") from None
    place.visitors += 1
    try:
        down = web.WebSocketResponse(
            protocols=[up.protocol] if up.protocol else (),
            max_msg_size=LARGEST_MESSAGE,
            compress=False,
            heartbeat=HEARTBEAT,
        )
        await down.prepare(request)
        bound_transport(request.transport)
        await _first_of(_to_visitor(up, down), _to_lab(request, down, up))
        await down.close(code=up.close_code or WSCloseCode.GOING_AWAY)
        return down
    finally:
        place.visitors -= 1
        context_of(request).places.left(place)
        await up.close()


async def _to_visitor(up: aiohttp.ClientWebSocketResponse, down: web.WebSocketResponse) -> None:
    # Sending waits while the visitor is slow; reading then stops too, and the lab drops outdated data.
    async for message in up:
        if message.type is WSMsgType.BINARY:
            await down.send_bytes(message.data)
        elif message.type is WSMsgType.TEXT:
            await down.send_str(message.data)


async def _to_lab(request: web.Request, down: web.WebSocketResponse, up: aiohttp.ClientWebSocketResponse) -> None:
    async for message in down:
        if message.type is WSMsgType.BINARY:
            await up.send_bytes(message.data)
        elif message.type is WSMsgType.TEXT:
            log.warning("Refused a text message from %s: the lab takes binary ones only.", request.remote)
            await down.close(code=WSCloseCode.UNSUPPORTED_DATA)
            return
        elif message.type is WSMsgType.ERROR:
            break
    # A visitor who leaves while a ping is answered has sent nothing wrong.
    if isinstance(wrong := down.exception(), aiohttp.WebSocketError):
        log.warning("Refused a message from %s: %s", request.remote, wrong)


async def _first_of(*works: Coroutine[Any, Any, None]) -> None:
    """Run both directions until one ends, and cancel the other."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
