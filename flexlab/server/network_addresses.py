"""Under which addresses other machines find this one, and a QR code for telephones."""

import contextlib
import ipaddress
import socket
from io import StringIO

import segno

from flexlab.server.settings import WILDCARDS, Settings

FAR_AWAY = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}
"""Addresses of no machine: the way there would lead over the interface that others are on. Nothing is sent."""


def network_addresses() -> list[str]:
    """This machine's addresses in its networks, the one of the default route first."""
    found: list[str] = []
    for family, far in FAR_AWAY.items():
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as plug:
            plug.connect((far, 9))
            found.append(plug.getsockname()[0])
    with contextlib.suppress(OSError):
        found += [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None)]
    return list(dict.fromkeys(address for address in found if _is_reachable(address)))


def _is_reachable(address: str) -> bool:
    number = ipaddress.ip_address(address.partition("%")[0])
    return not (number.is_loopback or number.is_link_local or number.is_unspecified)


def base_address(host: str, port: int) -> str:
    """Of a web server, without a path."""
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def outside_addresses(settings: Settings, port: int, token: str | None, path: str = "/") -> list[str]:
    """A page's addresses as other machines have them, token included; none of a server for this machine only."""
    if settings.is_local:
        return []
    hosts = network_addresses() if settings.host in WILDCARDS else [settings.host]
    return [base_address(host, port) + path + (f"?token={token}" if token else "") for host in hosts]


def terminal_code(address: str) -> str:
    """A QR code as lines of text, two rows of squares a line."""
    text = StringIO()
    segno.make(address, micro=False).terminal(text, compact=True, border=1)
    return text.getvalue()


def picture_code(address: str) -> str:
    """A QR code as the address of a picture that is in it, dark on light whatever the page's colours."""
    return segno.make(address, micro=False).svg_data_uri(scale=4, border=2, dark="#1c2430", light="#ffffff")
