"""The signals that end a command: Ctrl-C, `kill`, a closed terminal."""

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


def wanted() -> list[signal.Signals]:
    """Those that this process does not ignore: it ignores Ctrl-C in the background, and a closed terminal with nohup."""
    return [number for number in ENDING if signal.getsignal(number) != signal.SIG_IGN]


@contextmanager
def answering(answer: Callable[[int, Any], object], *also: signal.Signals) -> Generator[None]:
    """Call `answer` for each signal that is `wanted`, and for those in `also`, until the end of the block."""
    before = {number: signal.signal(number, answer) for number in {*wanted(), *also}}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def put_off() -> Generator[None]:
    """Put off the signals until the end of the block: what it does to a file and to numbers that belong together is whole."""
    if threading.current_thread() is not threading.main_thread():  # Python answers signals on its main thread.
        yield
        return
    come: list[int] = []
    try:
        with answering(lambda number, _: come.append(number)):
            yield
    finally:
        if come:
            signal.raise_signal(come[0])
