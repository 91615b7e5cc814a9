"""How the engine's kernel reaches a control law in Python: C functions, a socket, and the numbers that both sides share."""

import ctypes
from typing import Any, NamedTuple

import numpy as np

from flexlab.own_laws.message import MESSAGE_SIZE
from flexlab.physics.law_input import LAW_INPUT

AnswerFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)
"""A C function of the addresses of a message and of a `LAW_INPUT` record."""


class Channel(NamedTuple):
    """The first fields of `own_law.CHANNEL`."""

    answer: int
    late: int
    calls: int
    next_turn: int
    done: int


def address_of(function: Any) -> int:
    """Of a C function."""
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def message_at(address: int) -> np.ndarray:
    """The message (MESSAGE_SIZE,) at an address."""
    return np.ctypeslib.as_array((ctypes.c_double * MESSAGE_SIZE).from_address(address))


def now_at(address: int) -> np.ndarray:
    """The bytes of the `LAW_INPUT` record at an address."""
    return np.ctypeslib.as_array((ctypes.c_uint8 * LAW_INPUT.itemsize).from_address(address))
