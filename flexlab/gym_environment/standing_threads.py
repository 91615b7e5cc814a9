"""Threads that wait for work in machine code, each for its own part: worthwhile even for a tenth of a millisecond of work.

Waking a thread that the system has put to sleep, or waiting for Python's lock, takes as long as such work. So a thread polls
memory for the next order for a while before it goes to sleep, and the caller polls for the others' answers.
"""

import threading
import time
from collections.abc import Hashable, Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

from flexlab.compiled import call_whole_kernel, compiled, entry_point, whole_address

PATIENCE = 300_000
"""Number of polls, one or two tenths of a millisecond, after which a waiting thread gives up its processor."""
APART = 16
"""Places from one thread's number to the next one's: on one cache line the threads would slow each other down."""


def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    return builder.gep(context.make_array(kind)(context, builder, array).data, [index])


@intrinsic
def look(typing, numbers, index):
    """Read a number that another thread writes; everything it wrote before is then visible."""

    def code(context, builder, signature, values):
        return builder.load_atomic(_place(context, builder, signature.args[0], *values), "acquire", 8)

    return numba.int64(numbers, numba.int64), code


@intrinsic
def tell(typing, numbers, index, number):
    """Write a number that another thread polls, after everything that was written before."""

    def code(context, builder, signature, values):
        builder.store_atomic(values[2], _place(context, builder, signature.args[0], *values[:2]), "release", 8)
        return ir.Constant(ir.IntType(64), 0)

    return numba.int64(numbers, numba.int64, numba.int64), code


@compiled
def stand_by(address, arguments, orders, answers, place, last, patience):
    """Do one part at each new order and answer with its number; return the last order after `patience` polls without one."""
    looks = 0
    while looks < patience:
        order = look(orders, 0)
        looks += 1
        if order != last:
            call_whole_kernel(address, arguments)
            tell(answers, place, order)
            last, looks = order, 0
    return last


@compiled
def begin(address, arguments, orders, order):
    """Give an order, and do the caller's part of it."""
    tell(orders, 0, order)
    call_whole_kernel(address, arguments)


@compiled
def all_answered(answers, order, patience):
    """Whether every thread has answered an order, within `patience` polls for each."""
    for place in range(0, len(answers), APART):
        looks = 0
        while look(answers, place) != order:
            looks += 1
            if looks == patience:
                return False
    return True


class StandingThreads:
    """Runs a kernel's parts in parallel: the first on the caller's thread, each other on a thread of its own."""

    def __init__(self, kernel: Any, parts: Sequence[tuple[Any, ...]], variant: Hashable = None):
        """`kernel`: a `pluggable` one that returns a whole number; `parts`: its arguments, the same at every `run`.

        `variant`: as in `whole_address`.
        """
        address = whole_address(kernel, lambda: parts[0], variant)
        self._orders, self._answers = np.zeros(1, np.int64), np.zeros(APART * (len(parts) - 1), np.int64)
        self._order, self._asleep, self._closing = 0, 0, False
        self._changed = threading.Condition()
        self._first = address, parts[0], self._orders
        self._begin = entry_point(begin, *self._first, 0)
        self._answered = entry_point(all_answered, self._answers, 0, PATIENCE)
        work = [(address, part, self._orders, self._answers, APART * k) for k, part in enumerate(parts[1:])]
        wait = entry_point(stand_by, *work[0], 0, PATIENCE)
        for one in work:
            threading.Thread(target=self._serve, args=(wait, one), name="flexlab-standing", daemon=True).start()

    def _serve(self, wait: Any, work: tuple[Any, ...]) -> None:
        last = 0
        while True:
            last = wait(*work, last, PATIENCE)
            with self._changed:
                self._asleep += 1
                while self._order == last and not self._closing:
                    self._changed.wait()
                self._asleep -= 1
                if self._order == last:
                    return

    def run(self) -> None:
        """Run all parts."""
        with self._changed:
            self._order += 1
            if self._asleep:
                self._changed.notify_all()
        self._begin(*self._first, self._order)
        while not self._answered(self._answers, self._order, PATIENCE):
            time.sleep(0)  # There are more threads than processors.

    def close(self) -> None:
        """End the threads."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
