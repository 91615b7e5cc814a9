"""What a recording says about its run, texts for people and properties for programs, each with a checksum beside it.

Rerun's files have none: a scenario in which a disk changed a digit would pass for another. Blocks of samples have their own.
"""

import json
import platform
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Protocol
from uuid import uuid4

import llvmlite
import llvmlite.binding
import numba
import numpy as np
import rerun as rr

from flexlab import __version__
from flexlab.own.modules import packages_of
from flexlab.recording.store.formats import ARITHMETIC, FORMAT, OLDEST_READER
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status, WorldState
from flexlab.sim.signals import TABLE, own_signals
from flexlab.sim.snapshot import TICK, Event
from flexlab.text import number_text
from flexlab.views import REAL_TIME_FACTOR, fitting_exaggeration, views

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


def local_time() -> datetime:
    """The present time with its offset from UTC; in UTC if the time zone is none, as with TZ=UTC+99."""
    try:
        return datetime.now().astimezone()
    except ValueError:  # Its offset is a day or more.
        return datetime.now(UTC)


@dataclass(frozen=True)
class RunInfo:
    """Name, scenario and circumstances of one run."""

    name: str
    """The preset (or file) that the scenario came from."""
    scenario: Scenario
    sample_period: float = TICK
    """s."""
    start: WorldState | None = None
    """The world's state at the first sample; None: the scenario's own start."""
    started: datetime = field(default_factory=local_time)
    run_id: str = field(default_factory=lambda: str(uuid4()))
    """The same for all parts of a run and for file and live view."""
    part: int = 1
    """Number of the file within the run: a full disk ends one part, and the next begins when there is room."""
    begin_notes: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Notes written beside the file as it begins, so that they are there if its writer dies."""
    measured: str = ""
    """A description of a measured run's data, which cannot be drawn in space; empty for a simulated run."""
    recorded_by: Mapping[str, str | int] | None = None
    """Versions and machine that computed the samples, by the names of the recording's properties; None for the present ones."""

    @property
    def exaggeration(self) -> float:
        """The factor on the drawn deflection; it follows from the first scenario, so that it never jumps."""
        return fitting_exaggeration(self.scenario)

    @property
    def title(self) -> str:
        """The run's name in the viewer."""
        part = f", part {self.part}" if self.part > 1 else ""
        return f"{self.name} {self.started:%Y-%m-%d %H:%M:%S}{part}"


class RunNotes(Protocol):
    """Makes notes beside a recording from all samples and events of its run."""

    def add(self, samples: Samples) -> None:
        """Add a block (N >= 1)."""

    def add_event(self, event: Event) -> None:
        """Add an event."""

    def result(self, status: Status) -> dict[str, Any]:
        """Notes by name, plain enough for JSON; `status`: how the run ended."""
        ...


StartNotes = Callable[[str, Scenario], RunNotes]
"""Begins the notes of a run of this name and scenario."""


def parameters_text(info: RunInfo) -> str:
    """A description of the run as markdown, for the view beside the plots."""
    scenario, name, factor = info.scenario, info.name, info.exaggeration
    if info.measured:
        beside = f"It is held against the beam of the scenario below{f': {scenario.title}' if scenario.title else ''}."
        return f"# {name}\n\n{info.measured}\n\n{beside}\n\n```json\n{scenario_json(scenario)}\n```\n"
    heading = scenario.title or name
    notes = (
        f"- preset or file: **{name}**\n"
        f"- Deflections are drawn **× {number_text(factor)}**; plots are true.\n"
        "- Purple: desired pose and path. Orange arrows: internal force (1 m is 1000 N)."
    )
    return f"# {heading}\n\n{scenario.watch}\n\n{notes}\n\n```json\n{scenario_json(scenario)}\n```\n"


def signals_text(scenario: Scenario) -> str:
    """A description of each plotted signal as markdown, with its SI unit and its equation."""
    rows = [f"| {s.entity} | {s.title} | {s.meaning} |" for s in (*views(scenario), REAL_TIME_FACTOR)]
    table = "\n".join(["| entity | signal | meaning |", "|---|---|---|", *rows])
    exact = "`exact/samples` holds all of these in SI units and double precision; `flexlab.read` gives them back."
    lines = [f"- `{signal.name}`: {signal.text}" for signal in (*TABLE.values(), *own_signals(scenario))]
    return "\n\n".join([f"# Signals\n\n{table}", exact, "\n".join(lines)]) + "\n"


def scenario_json(scenario: Scenario) -> str:
    """The whole scenario as indented JSON; numbers keep every bit."""
    return json.dumps(scenario.model_dump(mode="json"), indent=1, ensure_ascii=False)


def run_properties(info: RunInfo) -> rr.AnyValues:
    """The properties that listings of recordings show: where the run came from and what wrote it."""
    values: dict[str, Any] = {
        "format": FORMAT,
        "oldest_reader": OLDEST_READER,
        "preset": info.name,
        "title": info.scenario.title,
        "started": info.started.isoformat(timespec="seconds"),
        "part": info.part,
        "sample_period_s": info.sample_period,
        "scenario": info.scenario.model_dump_json(),
        "has_start": int(info.start is not None),
        "rerun_version": rr.__version__,
        **(info.recorded_by or these_versions(info.scenario)),
    }
    return rr.AnyValues(**checked(values))


PACKAGES = "packages"
"""Property of a run under a control law in Python: name → version of the packages that the law imports, as JSON."""


def these_versions(scenario: Scenario | None = None) -> dict[str, str]:
    """Versions and machine that compute samples here; of a `scenario`, also the packages that its control law imports."""
    source = getattr(scenario and scenario.controller, "source", "")
    found = packages_of(source) if source else {}
    return {
        "arithmetic": ARITHMETIC,
        "flexlab_version": __version__,
        "numpy_version": np.__version__,
        "numba_version": numba.__version__,
        "llvmlite_version": llvmlite.__version__,
        "python_version": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "processor": llvmlite.binding.get_host_cpu_name(),
        **({PACKAGES: json.dumps(found)} if found else {}),
    }


def makers(known: Mapping[str, Any], computed_in: int) -> dict[str, str | int]:
    """Versions and machine of a run from its `known` properties, for `RunInfo.recorded_by`; `computed_in`: its format."""
    found: dict[str, str | int] = {name: str(known.get(name) or "unknown") for name in these_versions()}
    if known.get(PACKAGES):
        found[PACKAGES] = str(known[PACKAGES])
    return found if computed_in == FORMAT else found | {"computed_in": computed_in}
