"""A user's law in a process of its own: reads calls from a socket, answers them, says what goes wrong.

python -m flexlab.own_laws.child CALLS REPORTS LIFELINE FILE      (numbers of inherited sockets and of a pipe; see `serve`)
"""

import faulthandler
import json
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from flexlab.errors import FlexlabError
from flexlab.own_laws.execution import RunningLaw
from flexlab.own_laws.message import MESSAGE_SIZE
from flexlab.own_laws.running_text import TextProblem
from flexlab.own_laws.supervision import supervised
from flexlab.physics.law_input import LAW_INPUT

T = TypeVar("T")


def receive(calls: socket.socket, size: int) -> bytearray | None:
    """Exactly `size` bytes; None at the end."""
    data = bytearray(size)
    view, got = memoryview(data), 0
    while got < size:
        count = calls.recv_into(view[got:])
        if count == 0:
            return None
        got += count
    return data


class Reports:
    """Sentences for the parent, a line of JSON each."""

    def __init__(self, reports: socket.socket):
        self._reports = reports

    def say(self, **what: Any) -> None:
        """Tell the parent."""
        self._reports.sendall(json.dumps(what).encode() + b"\n")


def _watch_exits(reports: Reports, file: str) -> None:
    """Have os._exit and os.abort say where they were called: nothing else would know."""

    own = os.getpid()

    def telling(name: str, function: Any) -> Any:
        def end(*words: Any) -> None:
            if os.getpid() != own:  # That of a process which the text started says nothing of the text.
                function(*words)
            lines = [frame.lineno for frame in traceback.extract_stack() if frame.filename == file]
            line = f", line {lines[-1]}" if lines else ""
            reports.say(problem=f"{os.path.basename(file)}{line}: it ended its own process with os.{name}.")
            function(*words)

        return end

    os._exit, os.abort = telling("_exit", os._exit), telling("abort", os.abort)  # type: ignore[assignment]  # Types say that these never return.


def serve(load: Callable[[str, str], T], answer: Callable[[T, socket.socket, Reports], None]) -> None:
    """Run one text for the parent: `load` it (text, file), then `answer` calls until the parent closes the socket.

    The text comes first through the socket of the calls, after its length. When the other end of the lifeline is closed, this
    process ends with all that the text started.
    """
    calls, reported = socket.socket(fileno=int(sys.argv[1])), socket.socket(fileno=int(sys.argv[2]))
    file, reports = sys.argv[4], Reports(reported)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the lab, which ends this by closing the lifeline.
    name = os.path.basename(file)
    supervised([calls.fileno()], int(sys.argv[3]), lambda text: reports.say(problem=f"{name}: {text}."))
    reports.say(pid=os.getpid())
    # Asked for by the parent when an answer is late: the handler works even while Python cannot.
    faulthandler.register(signal.SIGUSR1, file=reported.fileno(), all_threads=False, chain=False)
    faulthandler.enable(file=reported.fileno(), all_threads=False)
    length = receive(calls, 8)
    if length is None:
        return
    text = receive(calls, int.from_bytes(length, "little"))
    if text is None:
        return
    _watch_exits(reports, file)
    try:
        loaded = load(text.decode(), file)
    except (TextProblem, FlexlabError) as error:
        reports.say(problem=str(error))
        return
    reports.say(ready=True)
    answer(loaded, calls, reports)


def _answer(law: RunningLaw, calls: socket.socket, reports: Reports) -> None:
    message_bytes = 8 * MESSAGE_SIZE
    while True:
        data = receive(calls, message_bytes + LAW_INPUT.itemsize)
        if data is None:
            return
        message = np.frombuffer(data, float, MESSAGE_SIZE)
        text = law.answer(message, np.frombuffer(data, np.uint8, LAW_INPUT.itemsize, message_bytes))
        if text:
            reports.say(problem=text)
        calls.sendall(memoryview(data)[:message_bytes])


if __name__ == "__main__":
    serve(RunningLaw, _answer)
