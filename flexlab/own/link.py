"""A control law that a program at tcp://HOST:PORT computes: one message each way per control instant.

The program listens; flexlab connects, once for each process that simulates. Every message is four bytes, its length, highest
byte first, and that many bytes of MessagePack (https://msgpack.org).

1. flexlab greets: {"protocol": "flexlab law", "version": 1, "asks": {name: [shape, unit]}, "answers": {name: [shape, unit]}}.
   The program greets back: {"version": 1}.
2. At each control instant flexlab sends {name: value} of all names in `asks` (`ASKS`; meanings: `flexlab.Measurement`). Numbers
   are float64, except `arm_count` and `delay`, which are whole; arrays are nested lists.
3. The program answers within a second with {"inputs": ...}, forces and torques at the grips, or {"torques": ...}, those of the
   joints. It may add {"memory": ...}, 16 numbers that come back with the next instant and are 0 at first. An answer
   {"error": "a sentence"} stops the run.

As with `OwnLaw.act`, an answer must follow from its message alone: flexlab may ask for an instant again, and a run may begin
again from anywhere. What is to be remembered belongs in `memory`.

In a scenario such a law is a text in Python, made from the address. Only a text equal to that one counts as such a law: a person
who is asked whether it may run then reads the address to which flexlab would connect.
"""

import re
import socket
import time
from typing import Any

import msgspec
import numpy as np

from flexlab.errors import ScenarioError
from flexlab.own.measurement import Measurement
from flexlab.own.reading import LONGEST_CLASS, SCHEME, TextProblem
from flexlab.text import visible

MOST_KEPT = 16
"""Numbers of the program's memory."""
LONGEST_HOST = LONGEST_CLASS - len("Tcp__65535")
"""The most characters of a host's name, which is a part of the name of the law's class."""
_ADDRESS = re.compile(rf"tcp://([A-Za-z0-9.-]{{1,{LONGEST_HOST}}}|\[[0-9A-Fa-f:.]+\]):([0-9]{{1,5}})/?")
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


def host_and_port(address: str) -> tuple[str, int]:
    """Host and port of an address tcp://HOST:PORT. Raises `ScenarioError` for anything else."""
    found = _ADDRESS.fullmatch(address.lower())
    if found is None or not 1 <= int(found[2]) <= 65535:
        text = (
            f"law = {address!r:.80} is not an address of a program: write tcp://HOST:PORT, as in tcp://localhost:9000."
        )
        raise ScenarioError([("controller.source", text)])
    return found[1].strip("[]"), int(found[2])


def text_of_program(address: str) -> str:
    """The text of the law that the program at an address computes. Raises `ScenarioError`."""
    host, port = host_and_port(address)
    written = f"{SCHEME}{f'[{host}]' if ':' in host else host}:{port}"
    return _TEXT.format(name=re.sub(r"\W", "_", f"Tcp_{host}_{port}"), address=written, most=MOST_KEPT)


def address_in(source: str) -> str:
    """The address to which a text of `text_of_program` connects; empty for any other text."""
    found = re.search(r'Link\("(.{1,300})"\)', source)
    address = found[1] if found else ""
    return address if _ADDRESS.fullmatch(address) and source == text_of_program(address) else ""


PROTOCOL, VERSION = "flexlab law", 1
GREETING_LIMIT = 5.0
"""Time to connect and to receive the greeting, s."""
ANSWER_LIMIT = 1.0
"""Time until an answer is late, s: long, as neither the network nor the program can be watched from here."""
LONGEST = 65536
"""The most bytes of a message from the program."""
HEAD = 4
"""Bytes of a message's length."""
ASKS: dict[str, tuple[list[Any], str]] = {
    "time": ([], "s"),
    "period": ([], "s"),
    "arm_count": ([], "1"),
    "pose": ([3], "m, m, rad"),
    "pose_rate": ([3], "m/s, m/s, rad/s"),
    "beam_rate": ([2], "kg·m/s, kg·m²/s"),
    "strains": (["gauges"], "1"),
    "joint_angles": (["arms", 3], "rad"),
    "joint_rates": (["arms", 3], "rad/s"),
    "torques": (["delay + 1", "arms", 3], "N·m"),
    "delay": ([], "1"),
    "desired_pose": ([3], "m, m, rad"),
    "desired_rate": ([3], "m/s, m/s, rad/s"),
    "desired_acceleration": ([3], "m/s², m/s², rad/s²"),
    "coming": ([3, 3], "m, rad; m/s, rad/s; m/s², rad/s²"),
    "weights": (["arms", 3], "N, N, N·m"),
    "share": (["arms"], "1"),
    "inertias": (["arms", 3, 3], "kg, kg·m, kg·m²"),
    "coriolis": (["arms", 3, 3], "N·s/m, N·s, N·m·s"),
    "jacobians": (["arms", 3, 3], "rad/m, 1"),
    "payload_mass": ([], "kg"),
    "payload_inertia": ([], "kg·m²"),
    "gravity": ([], "m/s²"),
    "wanted_force": ([], "N"),
}
"""Shape and unit of what a message holds besides `memory`, by the names of `Measurement`."""
ANSWERS: dict[str, tuple[list[Any], str]] = {"inputs": (["arms", 3], "N, N, N·m"), "torques": (["arms", 3], "N·m")}
MEMORY = {"memory": ([MOST_KEPT], "1")}


class Greeting(msgspec.Struct):
    """The program's greeting."""

    version: int


class Answer(msgspec.Struct):
    """The program's answer."""

    inputs: list[list[float]] | None = None
    torques: list[list[float]] | None = None
    memory: list[float] | None = None
    error: str | None = None


class Link:
    """A connection to a program. Raises `TextProblem`, with a sentence, whenever something is wrong with it."""

    def __init__(self, address: str):
        self._address = address
        self._socket: socket.socket | None = None
        self._encode = msgspec.msgpack.Encoder().encode
        self._greeting, self._answer = (msgspec.msgpack.Decoder(kind) for kind in (Greeting, Answer))
        self._connect()

    def ask(self, at: Measurement, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The inputs (arms, 3), N, N, N·m, and the memory that the program wants kept, (16,)."""
        if problem := self._unfit():
            if at.time > 0.0:
                raise self._problem(problem)
            self._connect()  # The program was restarted between two runs.
        asked = {name: getattr(at, name) for name in ASKS} | {"memory": kept}
        plain = {name: one.tolist() if isinstance(one, np.ndarray) else one for name, one in asked.items()}
        answer = self._exchange(plain, self._answer, ANSWER_LIMIT)
        if answer.error is not None:
            raise self._problem(visible(answer.error) or "it refused and gave no reason")
        wanted = (at.arm_count, 3)
        if answer.inputs is not None and answer.torques is not None:
            raise self._problem("its answer has both inputs and torques, and one of them would be lost")
        if answer.inputs is not None:
            inputs = self._numbers("inputs", answer.inputs, wanted)
        elif answer.torques is not None:
            inputs = at.from_torques(self._numbers("torques", answer.torques, wanted))
        else:
            raise self._problem("its answer has neither inputs nor torques")
        return inputs, kept if answer.memory is None else self._numbers("memory", answer.memory, (MOST_KEPT,))

    def _connect(self) -> None:
        host, port = host_and_port(self._address)
        try:
            self._socket = socket.create_connection((host, port), GREETING_LIMIT)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except TimeoutError:
            raise self._problem(f"nothing answers there within {GREETING_LIMIT:g} s: is the address right?") from None
        except UnicodeError:
            raise self._problem("no host has such a name: is the address right?") from None
        except OSError as error:
            why = error.strerror or type(error).__name__
            raise self._problem(f"no program answers there ({why}): start it, then run this again") from None
        about = {"protocol": PROTOCOL, "version": VERSION, "asks": ASKS | MEMORY, "answers": ANSWERS | MEMORY}
        version = self._exchange(about, self._greeting, GREETING_LIMIT).version
        if version != VERSION:
            raise self._problem(f"it speaks version {version} of the protocol, and this is version {VERSION}")

    def _exchange(self, message: Any, decoder: Any, limit: float) -> Any:
        """Send a message and return the answer, which is due within `limit` s."""
        body, link = self._encode(message), self._socket
        assert link is not None
        end = time.monotonic() + limit
        try:
            link.settimeout(limit)
            link.sendall(len(body).to_bytes(HEAD, "big") + body)
            size = int.from_bytes(self._received(link, HEAD, end), "big")
            if size > LONGEST:
                raise self._problem(f"it sent a message of {size} bytes, more than the {LONGEST} allowed")
            data = self._received(link, size, end)
        except TimeoutError:
            late = f"it did not greet within {limit:g} s: does it serve another run?"
            if decoder is self._answer:
                late = f"it did not answer within {limit:g} s"
            raise self._problem(late) from None
        except OSError as error:
            raise self._problem(f"the connection broke ({error.strerror or type(error).__name__})") from None
        try:
            return decoder.decode(data)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise self._problem(f"it sent an unreadable message ({visible(str(error))[:200]})") from None

    def _received(self, link: socket.socket, size: int, end: float) -> bytes:
        data = b""
        while len(data) < size:
            link.settimeout(max(end - time.monotonic(), 1e-3))
            part = link.recv(size - len(data))
            if not part:
                raise self._problem("it closed the connection")
            data += part
        return data

    def _unfit(self) -> str:
        """Why nothing can be asked: the other end is closed, or its next message would answer an earlier one; empty if it can."""
        if self._socket is None:
            return "the connection was closed"
        try:
            self._socket.settimeout(0)
            more = self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return ""
        except OSError:
            more = b""
        return "it sent more than one answer to a message" if more else "it closed the connection"

    def _numbers(self, name: str, given: Any, wanted: tuple[int, ...]) -> np.ndarray:
        shape = f"({', '.join(map(str, wanted))}{',' * (len(wanted) == 1)})"
        try:
            numbers = np.array(given, float)
        except ValueError:
            raise self._problem(f"its {name} are lists of unequal length instead of {shape} numbers") from None
        if numbers.shape != wanted:
            raise self._problem(f"the shape of its {name} is {numbers.shape} instead of {shape}")
        if not np.isfinite(numbers).all():
            raise self._problem(f"its {name} are not finite: {numbers.tolist()}")
        return numbers

    def _problem(self, text: str) -> TextProblem:
        """Close the connection and return the error."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        return TextProblem(f"{self._address}: {text.rstrip('.')}{'' if text.endswith('?') else '.'}")
