"""A scenario as a link: compressed JSON of what differs from the defaults, in characters that an address may hold."""

import base64
import binascii
import json
import math
import zlib
from itertools import accumulate
from typing import Any, cast

from pydantic import BaseModel, StrictInt, TypeAdapter

from flexlab.errors import PresetError
from flexlab.files import DuplicateField, unique_fields
from flexlab.own.path import OwnTrajectory
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.scenario import FORMAT, FORMAT_FIELD

LONGEST_LINK = 6000
"""Most characters of a link: web servers refuse an address of more than about 8000; a scenario takes about 400."""
LONGEST_TEXT = 1_000_000
"""Most bytes of JSON in a word when unpacked: a scenario has about 2000, the longest path with every digit 810,000, and a hostile
word could have gigabytes."""
COLUMNS = "columns"
"""The field of a path that holds its rows as `_columns` packs them."""
MOST_DIGITS, HIGHEST_ORDER = 9, 4
"""Most decimals of a table's columns, and the highest order of their differences."""
WHOLE_NUMBERS = TypeAdapter(list[list[StrictInt]])
LARGEST_DIFFERENCE = 2**53
"""A float can hold every whole number up to here."""


def encode_scenario(scenario: Scenario) -> str:
    """The scenario as a word for links and forms. Numbers keep every bit."""
    scenario = scenario.anew()
    data = scenario.model_dump(mode="json")
    if isinstance(scenario.trajectory, OwnTrajectory):  # Its poses are too long for a link, and follow from its text.
        del data["trajectory"]["table"], data["trajectory"]["table_of"]
    said: dict[str, Any] = {FORMAT_FIELD: FORMAT, **_said(scenario, data)}
    path: dict[str, Any] = said.get("trajectory", {})
    columns = _columns(path["rows"]) if "rows" in path else None
    if columns is not None:
        path[COLUMNS] = columns
        del path["rows"]
    text = _text(said)
    return base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


def scenario_path(word: str) -> str:
    """The server's address that opens the lab with a word of `encode_scenario`; empty if the word is too long for an address."""
    return f"/lab/?scenario={word}" if len(word) <= LONGEST_LINK else ""


def decode_scenario(word: str) -> Scenario:
    """The scenario in a word of `encode_scenario`. Raises `PresetError` if it holds none, `ScenarioError` if it is not valid."""
    try:
        packed = base64.b64decode(word + "=" * (-len(word) % 4), altchars=b"-_", validate=True)
        unpacker = zlib.decompressobj()
        text = unpacker.decompress(packed, LONGEST_TEXT)
        if not unpacker.eof:
            raise ValueError("it does not end")
        data = json.loads(text, parse_constant=_refuse, object_pairs_hook=unique_fields)
        _unpack_rows(data)
    except DuplicateField as error:
        raise PresetError(f"This link's scenario is not clear: {error}. Make the link again.") from None
    except (ValueError, binascii.Error, zlib.error, RecursionError):
        raise PresetError("This link holds no scenario, or was cut off on its way: copy it again as a whole.") from None
    return parse_scenario(data)


def _said(part: BaseModel, data: dict[str, Any]) -> dict[str, Any]:
    """The entries of a part's plain `data` that differ from their defaults or have none, and its kind."""
    said: dict[str, Any] = {}
    for name, value in data.items():
        field, own = type(part).model_fields[name], getattr(part, name)
        usual = field.get_default(call_default_factory=True)
        plain = usual.model_dump(mode="json") if isinstance(usual, BaseModel) else usual
        # Compared as text, because -0.0 is another number than 0.0. An arm's place and elbow have no default.
        if name == "kind" or field.is_required() or _text(value) != _text(plain):
            said[name] = _said(own, value) if isinstance(own, BaseModel) else value
    return said


def _columns(rows: list[list[float]]) -> list[list[int]] | None:
    """Pack rows of few decimals as [[digits], [order, differences...] of each column]; None for others.

    A smooth column of whole numbers has small differences: a table of a path's points takes a tenth of the characters.
    """
    values = [value for row in rows for value in row]
    digits = next((d for d in range(MOST_DIGITS + 1) if all(_has_digits(value, d) for value in values)), None)
    if digits is None:
        return None
    columns = [[digits]]
    for column in zip(*rows, strict=True):
        orders = [[round(value * 10**digits) for value in column]]
        for _ in range(HIGHEST_ORDER):
            orders.append([b - a for a, b in zip([0, *orders[-1]], orders[-1], strict=False)])
        order = min(range(len(orders)), key=lambda k: len(_text(orders[k])))
        columns.append([order, *orders[order]])
    return columns


def _has_digits(value: float, digits: int) -> bool:
    """Whether a number is, to the bit, one with this many decimals; False for -0.0."""
    return round(value * 10**digits) / 10**digits == value and (value != 0 or math.copysign(1, value) > 0)


def _unpack_rows(data: Any) -> None:
    """Replace what `_columns` packed with its rows; raises ValueError for anything else."""
    path: Any = cast("dict[str, Any]", data).get("trajectory") if isinstance(data, dict) else None
    if not isinstance(path, dict) or COLUMNS not in path:
        return
    path = cast("dict[str, Any]", path)
    [digits], *packed = WHOLE_NUMBERS.validate_python(path.pop(COLUMNS))
    if not 0 <= digits <= MOST_DIGITS or len({len(column) for column in packed}) != 1:
        raise ValueError("these columns make no rows")
    columns: list[list[float]] = []
    for order, *values in packed:
        if not 0 <= order <= HIGHEST_ORDER or max(map(abs, values), default=0) > LARGEST_DIFFERENCE:
            raise ValueError("these columns hold no differences")
        for _ in range(order):
            values = list(accumulate(values))
        columns.append([value / 10**digits for value in values])
    path["rows"] = [list(row) for row in zip(*columns, strict=True)]


def _text(data: Any) -> str:
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is not a number")
