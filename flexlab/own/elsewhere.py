"""A law that a program elsewhere computes, as the text of a law in Python: so it is allowed, recorded and run as those are.

Such a text is as plain as can be and made by one rule, so that it is known again: who is asked whether it may run is told to
which address flexlab would connect.
"""

import re
from typing import Any

from flexlab.errors import ScenarioError

SCHEME = "tcp://"
MOST_KEPT = 16
"""Numbers that such a program may have kept from one instant to the next."""
_ADDRESS = re.compile(r"tcp://([A-Za-z0-9.-]+|\[[0-9A-Fa-f:.]+\]):([0-9]{1,5})/?")
_TEXT = '''"""A control law that another program computes: flexlab asks it at each control instant."""

from flexlab import OwnLaw, memory
from flexlab.own.link import Link


class {name}(OwnLaw):
    """The program at {address} computes the inputs: one message each way per control instant."""

    kept = memory({most})

    def __init__(self):
        self.link = Link("{address}")

    def act(self, at):
        inputs, self.kept = self.link.ask(at, self.kept)
        return inputs
'''


def is_address(given: Any) -> bool:
    """Whether what is given for a law means a program elsewhere."""
    return isinstance(given, str) and given.lower().startswith(SCHEME)


def host_and_port(address: str) -> tuple[str, int]:
    """Of an address tcp://HOST:PORT. Raises `ScenarioError` for anything else."""
    found = _ADDRESS.fullmatch(address.lower())
    if found is None or not 1 <= int(found[2]) <= 65535:
        text = f"law = {address!r:.80} is no address of a program: write tcp://HOST:PORT, as in tcp://localhost:9000."
        raise ScenarioError([("controller.source", text)])
    return found[1].strip("[]"), int(found[2])


def text_of_program(address: str) -> str:
    """The text of the law that the program at an address computes. Raises `ScenarioError`."""
    host, port = host_and_port(address)
    return _text(re.sub(r"\W", "_", f"Tcp_{host}_{port}"), f"{SCHEME}{f'[{host}]' if ':' in host else host}:{port}")


def _text(name: str, address: str) -> str:
    return _TEXT.format(name=name, address=address, most=MOST_KEPT)


def address_in(source: str) -> str:
    """The address to which a text of `text_of_program` connects, and that alone; empty: it is another text."""
    found = re.search(r'Link\("(.{1,300})"\)', source)
    address = found[1] if found else ""
    return address if _ADDRESS.fullmatch(address) and source == text_of_program(address) else ""


def is_foreign(file: str) -> bool:
    """Whether what stands in a law's `file` was not written as Python: lines of its text mean nothing to anybody."""
    return is_address(file) or is_unit(file)


def is_unit(file: str) -> bool:
    """Whether a file is a functional mock-up unit, by its name."""
    return file.lower().endswith(".fmu")
