"""A scenario as a link: JSON, compressed, in letters that an address may hold."""

import base64
import binascii
import json
import zlib
from typing import Any

from flexlab.control.own_path import OwnTrajectory
from flexlab.errors import PresetError
from flexlab.presets import DuplicateField, unique_fields
from flexlab.scenario import Scenario, parse_scenario

LONGEST_LINK = 6000
"""Characters: web servers refuse an address of more than about 8000; a scenario takes about 800."""
LONGEST_TEXT = 200_000
"""Bytes of JSON that a link may hold when unpacked: a scenario has about 2000, a hostile link could have gigabytes."""


def encode_scenario(scenario: Scenario) -> str:
    """The scenario as a word for a link. Numbers keep every bit."""
    data = scenario.anew().model_dump(mode="json")
    if isinstance(scenario.trajectory, OwnTrajectory):  # Its poses are too long for a link, and follow from its text.
        del data["trajectory"]["table"], data["trajectory"]["table_of"]
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


def scenario_path(word: str) -> str:
    """Where in the server a word of `encode_scenario` opens the lab."""
    return f"/lab/?scenario={word}"


def decode_scenario(word: str) -> Scenario:
    """The scenario in a word of a link. Raises `PresetError` (not such a word) or `ScenarioError` (not valid)."""
    if len(word) > LONGEST_LINK:
        raise PresetError(f"This link is too long ({len(word)} characters, at most {LONGEST_LINK}): copy it again.")
    try:
        packed = base64.b64decode(word + "=" * (-len(word) % 4), altchars=b"-_", validate=True)
        unpacker = zlib.decompressobj()
        text = unpacker.decompress(packed, LONGEST_TEXT)
        if not unpacker.eof:
            raise ValueError("it does not end")
        data = json.loads(text, parse_constant=_refuse, object_pairs_hook=unique_fields)
    except DuplicateField as error:
        raise PresetError(f"This link's scenario is not clear: {error}. Make the link again.") from None
    except (ValueError, binascii.Error, zlib.error, RecursionError):
        raise PresetError("This link holds no scenario, or was cut off on its way: copy it again as a whole.") from None
    return parse_scenario(data)


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is not a number")
