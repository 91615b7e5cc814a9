"""Sockets that listen on exactly the requested address, or fail with one sentence that says why."""

import contextlib
import errno
import ipaddress
import os
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Generator
from pathlib import Path
from urllib.parse import urlsplit

from flexlab.errors import LabError

BACKLOG = 128
"""Connections that may wait for an answer: a class opens the page at the same moment."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Addresses that only this machine can reach."""
WILDCARDS = ("0.0.0.0", "::", "")
"""Hosts that stand for all addresses of this machine."""
UNIX = "unix:"
"""Prefix of a host that is the path of a Unix socket."""


MOST_HANDLES, FEWEST_HANDLES = 65_536, 64
"""Handles requested from the system, far more than labs and visitors need; with fewer than `FEWEST_HANDLES` a lab hangs."""


def raise_handles() -> int:
    """Raise this process's limit on open files and connections; returns it. Raises `LabError` if it is too low for a lab."""
    if sys.platform == "win32":
        return MOST_HANDLES
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_HANDLES if hard == resource.RLIM_INFINITY else min(MOST_HANDLES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
    most = MOST_HANDLES if soft == resource.RLIM_INFINITY else soft
    if most < FEWEST_HANDLES:
        needed = f"a lab needs {FEWEST_HANDLES}: allow more (ulimit -n {FEWEST_HANDLES})"
        raise LabError(f"This process may have {most} files and connections open at once, and {needed}.")
    return most


def hidden_loopback() -> str:
    """A random loopback address of this machine; 127.0.0.1 if the system has no other (macOS).

    For servers that answer to any host name: a foreign page whose host name resolves to this machine cannot find them there.
    """
    address = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return LOOPBACK[0]
    return address


def usual_spelling(host: str) -> str:
    """The usual spelling of a host that is an address: 0.0.0.0 for "0", "0x0" and "*", :: for "[::]". Names stay as they are."""
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        numeric = socket.getaddrinfo(bare, 0, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST | socket.AI_PASSIVE)
        address = ipaddress.ip_address(numeric[0][4][0])
    except (OSError, ValueError):
        return host
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return str(mapped or address)


def base_address(host: str, port: int) -> str:
    """The URL of a web server without a path; 127.0.0.1 if it listens on all addresses."""
    host = LOOPBACK[0] if host in WILDCARDS else host
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def name_in(host: str) -> str:
    """The name in a request's Host header, without its port; empty if the header is invalid."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:  # As for "[1]".
        return ""


def is_of_host(origin: str, host: str) -> bool:
    """Whether a request's Origin header names the site that its Host header names."""
    try:
        return urlsplit(origin).netloc.lower() == host.lower()
    except ValueError:
        return False


def free_ports(count: int) -> list[int]:
    """Ports that are free on 127.0.0.1 now, for a program that cannot take a listening socket. Raises `LabError`."""
    plugs = [listen(LOOPBACK[0], 0) for _ in range(count)]
    try:
        return [plug.getsockname()[1] for plug in plugs]
    finally:
        for plug in plugs:
            plug.close()


def listen(host: str, port: int) -> socket.socket:
    """A listening socket on exactly this host and port (0: any free one). Raises `LabError` with the reason if it cannot."""
    if not 0 <= port <= 65535:
        raise LabError(f"port = {port!r:.60} is not a port number: choose 0 (any free one) to 65535.")
    if host.startswith(UNIX):
        return _listen_on_file(host.removeprefix(UNIX))
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            usual_spelling(host), port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        plug = socket.socket(family, kind, protocol)
    except (OSError, ValueError):  # A label of over 63 letters is a UnicodeError.
        raise LabError(f"host = {host!r:.80} is not an address of this machine: use 127.0.0.1 or 0.0.0.0.") from None
    try:
        if sys.platform == "win32":  # Windows would otherwise share a taken port.
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        plug.bind(address)
        # Listening at once makes a second lab on the same port fail now, not when the first page is asked for.
        plug.listen(BACKLOG)
        plug.setblocking(False)
    except PermissionError:
        plug.close()
        raise LabError(f"port {port} needs special permissions on this machine: choose one above 1023.") from None
    except OSError as error:
        plug.close()
        if "in use" in str(error).lower() or getattr(error, "winerror", None) == 10048:
            raise LabError(
                f"port {port} is in use by another program: choose another one (0 takes any free port) or stop that program."
            ) from None
        if error.errno == errno.EADDRNOTAVAIL:
            raise LabError(f"host = {host} is not an address of this machine: use 127.0.0.1 or 0.0.0.0.") from None
        raise LabError(f"{host}:{port} cannot be opened ({error.strerror}): choose another host or port.") from None
    return plug


def _listen_on_file(path: str) -> socket.socket:
    """A listening Unix socket that only its owner may open; it replaces one that nobody listens on."""
    if not hasattr(socket, "AF_UNIX"):
        raise LabError("This system has no Unix sockets: give a host and a port.")
    plug = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            try:
                probe.connect(path)
            except ConnectionRefusedError:
                if not Path(path).is_socket():  # The system refuses a connection to any other file, too.
                    raise LabError(f"{path} is a file, not a socket: choose a path at which there is none.") from None
                Path(path).unlink()
            except FileNotFoundError:
                pass
            else:
                raise LabError(f"{path} is in use by another program: choose another one or stop that program.")
        before = os.umask(0o177)
        try:
            plug.bind(path)
        finally:
            os.umask(before)
        plug.listen(BACKLOG)
        plug.setblocking(False)
    except LabError:
        plug.close()
        raise
    except OSError as error:
        plug.close()
        why = error.strerror or error  # "AF_UNIX path too long" has no number.
        raise LabError(f"The socket {path} cannot be made ({why}): choose a short path in a folder of yours.") from None
    return plug


Answer = tuple[int, dict[str, str], bytes]
"""Status, headers and body of an answer."""


@contextlib.contextmanager
def serving_pages(plug: socket.socket, answer: Callable[[str, str], Answer]) -> Generator[None]:
    """Answer every GET request at a listening socket in the block by `answer(host, path)`; free its address afterwards."""
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status, headers, body = answer(self.headers.get("Host", ""), self.path)
            self.send_response(status)
            for name, value in (headers | {"Content-Length": str(len(body))}).items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Log nothing: a list of requests does not belong in a person's terminal."""

    class Server(ThreadingHTTPServer):
        def handle_error(self, request: object, client_address: object) -> None:
            """Ignore closed connections."""

    plug.setblocking(True)
    with Server(("", 0), Handler, bind_and_activate=False) as server:
        server.socket.close()
        server.socket = plug
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), name="flexlab-pages", daemon=True)
        thread.start()
        try:
            yield
        finally:
            server.shutdown()
            thread.join()
