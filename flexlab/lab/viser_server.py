"""A viser server as the lab needs it: on the asked port or not at all, no way out to the internet, slow readers bounded."""

import socket
from collections.abc import Callable

import viser

from flexlab.errors import LabError

SEND_BUFFER = 64 * 1024
"""Bytes that may wait in the kernel for one browser: without this bound a slow one shows pictures 36 s old."""


class LocalServer(viser.ViserServer):
    """A server that never opens viser's tunnel through an outside machine, whatever a browser asks."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: always None."""
        return None


def open_server(host: str, port: int, label: str) -> LocalServer:
    """A running server on `host`:`port` (0: any free port); raises `LabError` if it cannot have exactly that."""
    _check_free(host, port)
    server = LocalServer(host=host, port=port, label=label, verbose=False)
    # viser takes the next port when another program got in between.
    if port and server.get_port() != port:
        server.stop()
        raise LabError(_busy(port))
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.on_client_connect(_bound_buffer(server))
    return server


def _check_free(host: str, port: int) -> None:
    if not 0 <= port <= 65535:
        raise LabError(f"port = {port} is not a port number: choose 0 (any free one) to 65535.")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except socket.gaierror:
        raise LabError(f"host = {host!r} is not an address of this machine: use 127.0.0.1 or 0.0.0.0.") from None
    except PermissionError:
        raise LabError(f"port {port} needs special rights on this machine: choose one above 1023.") from None
    except OSError as error:
        if "in use" in str(error).lower():
            raise LabError(_busy(port)) from None
        raise LabError(f"{host}:{port} cannot be opened ({error.strerror}): choose another host or port.") from None


def _busy(port: int) -> str:
    return f"port {port} is in use by another program: choose another one (0 takes any free port) or stop that program."


def _bound_buffer(server: viser.ViserServer) -> Callable:
    async def bound(client: viser.ClientHandle) -> None:
        # viser offers no way to the socket; without it nothing breaks but a slow browser's picture lags.
        connection = server._websock_server._live_connections.get(client.client_id)
        transport = getattr(connection, "transport", None)
        plug = transport.get_extra_info("socket") if transport is not None else None
        if plug is not None:
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    return bound
