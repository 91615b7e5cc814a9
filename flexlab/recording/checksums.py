"""Checksums of a recording's texts, kept beside them.

Rerun's files have none: a scenario in which a disk changed a digit would pass for another. Blocks of samples have their own.
"""

import json
import zlib
from collections.abc import Mapping
from typing import Any

CHECK = "check"
"""The component beside a text, or beside values, that holds the checksum."""
GAPS = "gaps"
"""Property of a recording that lacks a part of its run: its disk was full, or its file was begun late."""


def checked(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values in JSON's types with their checksum; without empty texts, as rerun keeps none."""
    kept = {name: value for name, value in values.items() if value != ""}
    return {**kept, CHECK: _checksum_of(kept)}


def unchecked(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values without their checksum, which older recordings lack. Raises ValueError if it is wrong."""
    rest = {name: value for name, value in values.items() if name != CHECK}
    # The first recordings with checksums included an empty title, which rerun kept or not.
    known = {_checksum_of(rest), _checksum_of({"title": "", **rest})}
    if CHECK in values and values[CHECK] not in known:
        raise ValueError(f"the checksum of {', '.join(rest)} is wrong")
    return rest


def _checksum_of(values: Mapping[str, Any]) -> str:
    # Damaged values may be of any type.
    return str(zlib.crc32(json.dumps(values, sort_keys=True, default=repr).encode()))
