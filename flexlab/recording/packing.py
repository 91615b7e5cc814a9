"""Packs numbers that change smoothly: third differences of their bit patterns, byte by byte, as a zlib stream."""

import struct
import zlib
from typing import Any

import numpy as np

from flexlab.compiled import compiled

COMPRESSION = 1
"""zlib level: 6 saves 2 % and costs half as much again."""

LONG = 1000
"""Rows from which on most columns of the lower planes are stored as they are: they hardly pack and cost most of zlib's time."""
NOISY, SMOOTH = 3, 4
"""The planes below the first are noise, where few columns pack; those from the second on are mostly zeros."""
WINDOWS, WINDOW, FEW = 8, 64, 50
"""Pieces of a noisy column that are looked at, their bytes, and the mean number of different ones in them below which it packs:
57 of random bytes."""
LAGS, REACH = (1, 2, 3), 32_000
"""Columns before one that it may repeat, as an arm's force does the other arm's; bytes back that zlib finds them."""
MOST_STORED = 65_535
"""Bytes of a stored part of a zlib stream."""

TILE = 128
"""Rows that are read again for each column: they stay in the processor's cache."""


@compiled
def byte_planes(patterns, planes):
    """Fill `planes` (8, k, N), uint8, with the bytes of the columns of `patterns` (N, k), int64, the lowest first.

    Each column is differenced three times, as if zeros stood before it, and its sign moved to the lowest bit, so that small
    numbers of either sign have empty upper bytes. Arithmetic is modulo 2⁶⁴: nothing is lost.
    """
    rows, count = patterns.shape
    for first in range(0, rows, TILE):
        last = min(first + TILE, rows)
        for c in range(count):
            x1 = patterns[first - 1, c] if first > 0 else 0
            x2 = patterns[first - 2, c] if first > 0 else 0
            x3 = patterns[first - 3, c] if first > 0 else 0
            for i in range(first, last):
                x = patterns[i, c]
                difference = x - 3 * x1 + 3 * x2 - x3
                x1, x2, x3 = x, x1, x2
                folded = (difference << 1) ^ (difference >> 63)
                for k in range(8):
                    planes[k, c, i] = (folded >> (8 * k)) & 255


def packed(head: bytes, planes: np.ndarray) -> bytes:
    """A zlib stream (RFC 1950, 1951) of `head` and planes (8, k, N); of long ones, noisy columns are stored as they are."""
    _, count, rows = planes.shape
    if rows < LONG:
        return zlib.compress(head + planes.tobytes(), COMPRESSION)
    data = planes.reshape(-1).data
    packs = np.append(_pack(planes[:NOISY]), True)
    first_smooth = SMOOTH * count * rows
    edges = np.concatenate([[0], np.flatnonzero(np.diff(packs)) + 1, [SMOOTH * count]]) * rows
    parts = [b"\x78\x01", _deflated(head)]
    for first, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if packs[min(first // rows, len(packs) - 1)]:
            parts.append(_deflated(data[first:end], before=data[max(0, first - REACH) : first]))
        else:
            for start in range(first, end, MOST_STORED):
                piece = data[start : min(start + MOST_STORED, end)]
                parts += [struct.pack("<BHH", 0, len(piece), len(piece) ^ 0xFFFF), piece]
    parts += [_deflated(data[first_smooth:], zlib.Z_RLE), struct.pack("<BHH", 1, 0, 0xFFFF)]
    return b"".join([*parts, zlib.adler32(data, zlib.adler32(head)).to_bytes(4, "big")])


def _deflated(data: Any, strategy: int = zlib.Z_DEFAULT_STRATEGY, before: Any = b"") -> bytes:
    """Deflated data that end with a whole byte. `before`: what stands before them in the stream."""
    packer = zlib.compressobj(COMPRESSION, zlib.DEFLATED, -zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, strategy, before)
    return packer.compress(data) + packer.flush(zlib.Z_SYNC_FLUSH)


def _pack(planes: np.ndarray) -> np.ndarray:
    """Which columns of noisy planes (p, k, N) are worth packing, (p k,): those of few values, or that repeat another one."""
    _, _, rows = planes.shape
    starts = np.linspace(0, rows - WINDOW, WINDOWS).astype(int)
    looked_at = np.sort(np.stack([planes[:, :, start : start + WINDOW] for start in starts], axis=2), axis=3)
    found = 1 + (np.diff(looked_at, axis=3) != 0).sum(axis=3).mean(axis=2) < FEW
    for lag in LAGS:
        if lag * rows <= REACH:
            same = (looked_at[:, lag:] == looked_at[:, :-lag]).all(axis=(2, 3))
            for plane, column in np.argwhere(same):
                found[plane, column + lag] |= np.array_equal(planes[plane, column], planes[plane, column + lag])
    return found.ravel()
