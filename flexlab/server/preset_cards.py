"""The presets' cards on the start page: each version of a file is read once, and its picture drawn in another process."""

import asyncio
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np
from markupsafe import Markup

from flexlab.control.motion import poses
from flexlab.errors import FlexlabError
from flexlab.presets import load_scenario_file, preset_files
from flexlab.scenario import Scenario
from flexlab.server.limits import THE_SERVER
from flexlab.server.pages import part
from flexlab.server.tasks import Tasks
from flexlab.sim.geometry import arm_points, beam_points
from flexlab.sim.target import build_trajectory
from flexlab.sim.world import World

PATH_POINTS, BEAM_POINTS = 96, 24
PATH_TIME = 4.0
"""Time over which the path is drawn, s: two periods of the slowest preset."""
MARGIN = 0.12
"""Margin on each side, as a share of the size of what is drawn."""
ASPECT = 16 / 10
MOST_DRAWN = 200
"""Most presets that get a picture."""
MOST_READ = 1000
"""Most presets kept in memory."""
FileState = tuple[str, int, int]
"""Path, size and modification time; a file in another state counts as another preset."""


def thumbnail(scenario: Scenario) -> Markup:
    """Draw arms, beam and path at the start, as SVG; empty for a scenario that cannot start."""
    try:
        world = World(scenario)
        start = world.observe()
    except FlexlabError:
        return Markup("")
    arms, beam = arm_points(scenario, start)[0], beam_points(scenario, start, BEAM_POINTS)[0]
    path = poses(build_trajectory(scenario), np.linspace(0.0, PATH_TIME, PATH_POINTS))[:, 0, :2]
    everything = np.concatenate([arms.reshape(-1, 2), beam, path])
    if not np.isfinite(everything).all():
        return Markup("")
    drawn = [{"points": _points(arm), "x": f"{arm[0, 0]:.3f}", "y": f"{-arm[0, 1]:.3f}"} for arm in arms]
    return part("drawing", _box(everything), _points(path), drawn, _points(beam))


def _box(points: np.ndarray) -> str:
    """The part of the plane to show, y downwards as in SVG."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, (high - low) * (1 + 2 * MARGIN)
    width = max(size[0], size[1] * ASPECT)
    return f"{center[0] - width / 2:.3f} {-center[1] - width / ASPECT / 2:.3f} {width:.3f} {width / ASPECT:.3f}"


def _points(points: np.ndarray) -> str:
    return " ".join(f"{x:.3f},{-y:.3f}" for x, y in points)


@dataclass(frozen=True)
class PresetCard:
    """A preset as its card shows it."""

    name: str
    state: FileState
    scenario: Scenario | None
    problem: str = ""


class PresetCards:
    """All cards of one server. `drawing` returns pictures once they are drawn, after the first call of `look`."""

    def __init__(self, tasks: Tasks):
        self._tasks = tasks
        self._card = lru_cache(MOST_READ)(_card)
        self._drawings: dict[FileState, Markup] = {}
        self._drawing: asyncio.Task[None] | None = None

    def read(self) -> list[PresetCard]:
        """Read the present presets, in the order of the menu. For any thread."""
        return [self._card(name, _state(file)) for name, file in preset_files().items()]

    async def look(self, pictured: Collection[str]) -> list[PresetCard]:
        """As `read`, and start drawing the missing pictures. `pictured`: names of presets that have one already."""
        cards = await asyncio.to_thread(self.read)
        if self._drawing is None or self._drawing.done():
            self._drawing = asyncio.create_task(self._draw([card for card in cards if card.name not in pictured]))
        return cards

    def drawing(self, card: PresetCard) -> Markup:
        """The picture of a preset; empty until it is drawn."""
        return self._drawings.get(card.state, Markup(""))

    async def _draw(self, cards: list[PresetCard]) -> None:
        self._drawings = {card.state: self._drawings[card.state] for card in cards if card.state in self._drawings}
        wanted = {card.state: card.scenario for card in cards if card.scenario and card.state not in self._drawings}
        wanted = dict(islice(wanted.items(), MOST_DRAWN))
        with suppress(FlexlabError):  # The server is busy: the next look tries again.
            if wanted:
                drawn = await self._tasks.run(THE_SERVER, draw_all, list(wanted.values()))
                self._drawings |= zip(wanted, drawn, strict=True)


def draw_all(scenarios: list[Scenario]) -> list[Markup]:
    """Draw the pictures of some scenarios, as a job."""
    return [thumbnail(scenario) for scenario in scenarios]


def _state(file: Path) -> FileState:
    try:
        stat = file.stat()
        return str(file), stat.st_size, stat.st_mtime_ns
    except OSError:
        return str(file), 0, 0


def _card(name: str, state: FileState) -> PresetCard:
    try:
        return PresetCard(name, state, load_scenario_file(Path(state[0])))
    except FlexlabError as error:
        return PresetCard(name, state, None, str(error))
