"""Samples come out of an encoded block with the same bits, whatever these are."""

import json
import struct
import zlib
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from recording_helpers import assert_same_bits

from flexlab.errors import RecordingError
from flexlab.recording.codec import PACKING, TRAILER, _unpack_zstd, decode_block, encode_block
from flexlab.sim.samples import Run, Samples, join_blocks, row_length, rows_to_samples

any_bits = st.integers(0, 2**64 - 1)


@given(st.integers(1, 5), st.integers(1, 2), st.integers(0, 6), st.data())
def test_any_bit_pattern_comes_back(count: int, arms: int, coordinates: int, data: st.DataObject) -> None:
    bits = data.draw(arrays(np.uint64, (count, row_length(arms, coordinates)), elements=any_bits))
    samples = rows_to_samples(bits.view(np.float64), arms)
    assert_same_bits(decode_block(encode_block(samples))[0], samples)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("rows", [1, 2, 3, 385, 3000])
def test_a_block_of_any_length_comes_back_whatever_its_bits(rows: int) -> None:
    """Noise, columns that repeat others, and columns that hold little information."""
    random = np.random.default_rng(rows)
    bits = random.integers(0, 2**64, (rows, row_length(2, 6)), np.uint64)
    bits[:, 5:8], bits[:, 9], bits[:, 12] = bits[:, 2:5], 0, np.arange(rows)
    samples = rows_to_samples(bits.view(np.float64), 2)
    assert_same_bits(decode_block(encode_block(samples))[0], samples)


def test_a_long_block_of_a_run_is_smaller_than_zlib_makes_it(run: Run) -> None:
    samples = run.slice(0, 1500)
    data = encode_block(samples)
    assert_same_bits(decode_block(data)[0], samples)
    assert len(data) < len(by_zlib(data))


def by_zlib(data: bytes) -> bytes:
    """A block packed as in formats 1 and 2 of recordings."""
    return zlib.compress(_unpack_zstd(data), 1)


def test_a_block_packed_by_zlib_can_be_read(run: Run) -> None:
    samples = run.slice(0, 300)
    assert_same_bits(decode_block(by_zlib(encode_block(samples)))[0], samples)


def test_a_real_run_comes_back_read_only_and_small(run: Run) -> None:
    samples = run.slice(500, 1000)
    data = encode_block(samples)
    found = decode_block(data)[0]
    assert_same_bits(found, samples)
    assert not any(getattr(found, field.name).flags.writeable for field in fields(Samples))
    signals = sum(getattr(run, field.name)[0].size for field in fields(Samples))
    assert len(data) < 0.55 * 8 * 500 * (signals - 3), "without the tracking error, which follows from the poses"


def test_blocks_join_in_order(run: Run) -> None:
    pieces = [run.slice(0, 1), run.slice(1, 17), run.slice(17, 400)]
    assert_same_bits(join_blocks([decode_block(encode_block(piece))[0] for piece in pieces]), run.slice(0, 400))


def flipped(data: bytes, place: int) -> bytes:
    """The same bytes with one bit flipped."""
    return data[:place] + bytes([data[place] ^ 16]) + data[place + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: b"",
        lambda d: d[:-7],
        lambda d: b"x" * 50,
        lambda d: zlib.compress(b"{}"),
        lambda d: zlib.compress(b"{}")[:5],
        lambda d: d[:4],
        lambda d: flipped(d, 0),
        lambda d: flipped(d, 200),
        lambda d: flipped(d, len(d) // 2),
        lambda d: flipped(d, len(d) - 8),
        lambda d: flipped(d, len(d) - 1),
    ],
)
def test_bytes_that_are_no_block_are_refused_in_a_sentence(run: Run, damage) -> None:
    with pytest.raises(RecordingError, match="exact samples cannot be read"):
        decode_block(damage(encode_block(run.slice(0, 10))))


def test_a_block_of_an_unknown_format_is_refused_with_its_number(run: Run) -> None:
    raw = bytes(_unpack_zstd(encode_block(run.slice(0, 2)))).replace(b'"format": 1', b'"format": 9')
    frame = PACKING.compress(raw, asbytes=True)
    for block in (frame + TRAILER.pack(len(raw), zlib.adler32(frame)), zlib.compress(raw)):
        with pytest.raises(RecordingError, match="format 9"):
            decode_block(block)


@pytest.mark.parametrize(
    ("rows", "widths"), [(2, [1, 4, -4]), (2, [1, 4]), (2, [1, -4]), (-2, [-1]), (0, [1, 4]), (2.0, [1])]
)
def test_a_block_whose_header_does_not_fit_its_numbers_is_refused(rows: float, widths: list[int]) -> None:
    signals = [[name, [width]] for name, width in zip(("pose", "time", "pose_rate"), widths, strict=False)]
    header = json.dumps({"format": 1, "rows": rows, "signals": signals, "derived": []}).encode()
    raw = struct.pack("<I", len(header)) + header + bytes(8 * 2)
    frame = PACKING.compress(raw, asbytes=True)
    with pytest.raises(RecordingError, match="exact samples cannot be read"):
        decode_block(frame + TRAILER.pack(len(raw), zlib.adler32(frame)))
