"""The lab's viser server: on the requested port or not at all, with admission of requests and small send buffers."""

import hmac
from functools import partial

import viser
from websockets.http11 import Request

from flexlab.lab.input_guard import InputGuard
from flexlab.lab.viser_internals import GuardedServer, bound_buffer
from flexlab.sockets import LOOPBACK, is_of_host, listen, name_in
from flexlab.text import limited

SECRET_HEADER = "Flexlab-Proxy"
"""The request header by which a server in front of the lab identifies itself."""

LIBRARY_LOGS = ("websockets.server", "asyncio")
"""Logs of libraries that a visitor could flood."""


def open_server(port: int, guard: InputGuard, secret: str = "", script: str = "", sheet: str = "") -> GuardedServer:
    """A running server on this machine's `port` (0 for any free one); raises `LabError` if that port is not available.

    With a `secret` it answers only requests that carry it; without one, only requests from its own page.
    `script` and style `sheet` are added to the page.
    """
    for name in LIBRARY_LOGS:
        limited(name)
    plug, admission = listen(LOOPBACK[0], port), partial(_knows, secret) if secret else _own_page
    try:
        server = GuardedServer(plug, admission, guard.check, script, sheet)
    except BaseException:
        plug.close()
        raise
    set_theme(server.gui, dark=False)

    async def bound(client: viser.ClientHandle) -> None:
        bound_buffer(server, client)

    server.on_client_connect(bound)
    return server


def set_theme(gui: viser.GuiApi, dark: bool) -> None:
    """Set the page's theme, for all browsers or for one."""
    gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark)


def _knows(secret: str, request: Request) -> str:
    given = request.headers.get_all(SECRET_HEADER)
    if len(given) == 1 and hmac.compare_digest(given[0].encode("utf-8", "replace"), secret.encode()):
        return ""
    return "This is the inside of a lab: open it by the address that flexlab printed."


def _own_page(request: Request) -> str:
    """Refuse requests by another site's page through a visitor's browser, also under a name that resolves to this machine."""
    named = request.headers.get_all("Host")
    if len(named) != 1:
        return "This request names no host."
    if name_in(named[0]) not in LOOPBACK:
        return "This lab is open to this machine only: use 127.0.0.1."
    origins = request.headers.get_all("Origin")
    if not all(is_of_host(origin, named[0]) for origin in origins):
        return "This came from a page of another site."
    return ""
