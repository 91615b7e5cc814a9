"""A viser server as the lab needs it: on the asked port or not at all, for callers who may come, slow readers bounded."""

import hmac
from functools import partial

import viser
from websockets.http11 import Request

from flexlab.lab.input_guard import InputGuard
from flexlab.lab.viser_internals import GuardedServer, bound_buffer
from flexlab.sockets import LOOPBACK, is_of_host, listen, name_in
from flexlab.text import limited

SECRET_HEADER = "Flexlab-Proxy"
"""The request header in which a server in front of the lab identifies itself."""

LIBRARY_LOGS = ("websockets.server", "asyncio")
"""Logs of libraries in which a visitor could write lines without end."""


def open_server(port: int, guard: InputGuard, secret: str = "", script: str = "", sheet: str = "") -> GuardedServer:
    """A running server on this machine's `port` (0: any free one); raises `LabError` if it cannot have exactly that.

    With a `secret` it answers only requests that carry it; without one, only what comes from its own page.
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
    """Another site's page must not drive the lab through a visitor's browser, nor under a name that points here."""
    named = request.headers.get_all("Host")
    if len(named) != 1:
        return "This request names no host."
    if name_in(named[0]) not in LOOPBACK:
        return "This lab is open to this machine only: use 127.0.0.1."
    origins = request.headers.get_all("Origin")
    if not all(is_of_host(origin, named[0]) for origin in origins):
        return "This came from a page of another site."
    return ""
