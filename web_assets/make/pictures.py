"""Draws the small picture of every preset, and the guide's overview, from short simulations.

    .venv/bin/python web_assets/make/pictures.py

The colours are Okabe and Ito's, distinct with any colour vision; the grey is of medium brightness, so that it stands out from
white and from black.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlab.assets import presets_folder
from flexlab.control.paths.sine import SineTrajectory
from flexlab.lab.view_settings import tamed_exaggeration
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.geometry import arm_points, beam_points, link_points
from flexlab.sim.samples import Run, Samples
from flexlab.sim.simulate import simulate
from flexlab.text import number_text
from flexlab.views import fitting_exaggeration

ASSETS = Path(__file__).resolve().parent.parent
ARM_COLORS, BEAM, DESIRED, GRAY = ("#0072b2", "#d55e00"), "#009e73", "#cc79a7", "#808890"
INK = "#5b6675"
"""Colour of words: the start page inverts brightness in dark mode."""
LINK_WIDTHS = (7.0, 6.0, 4.0)
"""Stroke widths, px."""
OVERVIEW_FACTOR = 100
"""Factor on the deflection in the guide's picture, which draws it 70 mm large."""
GUIDE_TEXT = 14
"""Size of its words, px: the guide draws it in four fifths of its size."""
COLUMNS = 117
"""Number of columns of the curve at the foot, each drawn by its lowest and highest value."""
BLUR = 6
"""Number of shapes of the beam drawn within one period of its vibration."""


class Curve(NamedTuple):
    """The curve at the foot of a picture. `values` gives (N,) in `unit`."""

    label: str
    unit: str
    seconds: float
    values: Callable[[Samples], np.ndarray]


DEFLECTION = Curve("mid-span deflection", "mm", 1.0, lambda samples: 1e3 * samples.midspan_deflection)
ERROR = Curve("tracking error y", "mm", 3.0, lambda samples: 1e3 * samples.tracking_error[:, 1])
CURVES = {"weak-feedback": ERROR, "fast-adaptation": ERROR, "slow-adaptation": ERROR, "gravity": DEFLECTION}
"""Curves of some presets; the others show the deflection."""


class Canvas:
    """Collects SVG elements; maps the plane (m) to a box of the picture (px)."""

    def __init__(self, width: int, height: int, low: np.ndarray, high: np.ndarray, margin: float, foot: float):
        self.width, self.height = width, height
        self.parts: list[str] = []
        size = high - low
        self.scale = min((width - 2 * margin) / size[0], (height - foot - 2 * margin) / size[1])
        self._left = 0.5 * width - self.scale * 0.5 * (low[0] + high[0])
        self._bottom = height - foot - margin + self.scale * low[1]

    def at(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the plane in px."""
        return np.stack([self._left + self.scale * points[..., 0], self._bottom - self.scale * points[..., 1]], axis=-1)

    def line(self, pixels: np.ndarray, color: str, width: float, more: str = "") -> None:
        """A line through px points (N, 2)."""
        data = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in pixels)
        style = f'fill="none" stroke="{color}" stroke-width="{width:g}" stroke-linecap="round" stroke-linejoin="round"'
        self.parts.append(f'<path d="{data}" {style} {more}/>'.replace(" />", "/>"))

    def dot(self, pixel: np.ndarray, radius: float, color: str) -> None:
        """A filled circle."""
        self.parts.append(f'<circle cx="{pixel[0]:.1f}" cy="{pixel[1]:.1f}" r="{radius:g}" fill="{color}"/>')

    def text(self, x: float, y: float, words: str, color: str = INK, anchor: str = "start", size: float = 11) -> None:
        """Words with their baseline at px (x, y)."""
        font = f'font-family="system-ui,sans-serif" font-size="{size:g}" text-anchor="{anchor}" fill="{color}"'
        self.parts.append(f'<text x="{x:.0f}" y="{y:.0f}" {font}>{words}</text>')

    def svg(self, title: str) -> str:
        """The whole picture."""
        size = f'width="{self.width}" height="{self.height}" viewBox="0 0 {self.width} {self.height}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<title>{title}</title>\n'
        return head + "\n".join(self.parts) + "\n</svg>\n"


def draw_arms(canvas: Canvas, scenario: Scenario, sample: Samples) -> None:
    """Bases, links and joints at one sample."""
    for points, color in zip(canvas.at(arm_points(scenario, sample)[0]), ARM_COLORS, strict=False):
        x, y = points[0]
        canvas.line(np.array([[x - 11, y + 7], [x + 11, y + 7]]), GRAY, 5)
        for link, width in enumerate(LINK_WIDTHS):
            canvas.line(points[link : link + 2], color, width)
        for joint in range(3):
            canvas.dot(points[joint], 4.6 - 0.6 * joint, GRAY)


def draw_path(canvas: Canvas, run: Run) -> None:
    """The desired path of the payload's middle."""
    path = run.scenario.trajectory
    once = run.time <= (1 / min(path.frequency) if isinstance(path, SineTrajectory) else path.window[1])
    canvas.line(canvas.at(run.desired_pose[once, :2][::20]), DESIRED, 1.2)


def draw_beam(canvas: Canvas, run: Run, row: int, factor: float) -> None:
    """The beam at one row, and faintly its shapes within the period of vibration that follows, all at the same pose."""
    scenario = run.scenario
    period = 2 * math.pi / float(build_beam(scenario.payload).modes.omega.min())
    tick = float(run.time[1])
    now = run.slice(row, row + 1)
    for step in range(1, BLUR):
        other = min(row + round(step * period / BLUR / tick), len(run) - 1)
        shape = now.having(beam_coordinates=run.beam_coordinates[other : other + 1])
        canvas.line(canvas.at(beam_points(scenario, shape, 25, factor)[0]), BEAM, 1.5, 'opacity="0.4"')
    canvas.line(canvas.at(beam_points(scenario, now, 33, factor)[0]), BEAM, 4)


def draw_curve(canvas: Canvas, run: Run, curve: Curve) -> None:
    """The curve at the foot, with its range."""
    part = run.slice(0, int(np.searchsorted(run.time, curve.seconds)))
    values = curve.values(part)
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    top, bottom, left, right = canvas.height - 38, canvas.height - 16, 8, canvas.width - 8
    scale = (bottom - top) / max(high - low, 1e-12)
    x = left + (right - left) * part.time / curve.seconds
    y = bottom - scale * (values - low)
    canvas.line(np.array([[left, bottom + scale * low], [right, bottom + scale * low]]), GRAY, 0.7, 'opacity="0.7"')
    rows = np.array_split(np.arange(len(x)), COLUMNS)
    extremes = [index[pick] for index in rows for pick in sorted({int(y[index].argmin()), int(y[index].argmax())})]
    canvas.line(np.column_stack([x[extremes], y[extremes]]), BEAM if curve is DEFLECTION else DESIRED, 1.2)
    largest = float(np.abs(values).max())
    size = f"{largest:.2g} {curve.unit}" if largest >= 0.01 else f"{1e3 * largest:.2g} µm"
    canvas.text(left, canvas.height - 4, f"{curve.label}, up to {size}")
    canvas.text(right, canvas.height - 4, f"{curve.seconds:g} s", anchor="end")


def draw_preset(name: str) -> str:
    """The small picture of a preset."""
    scenario = load_preset(name)
    run = simulate(scenario, 3.0, 0.001)
    middle = run.midspan_deflection if len(scenario.arms) == 2 else run.beam_coordinates[:, -2]
    row = int(np.abs(middle).argmax())
    # As in the lab, to which the picture links.
    largest = float(np.abs(middle).max())
    factor = tamed_exaggeration(fitting_exaggeration(scenario), largest, scenario.payload.length)
    points = np.concatenate([arm_points(scenario, run).reshape(-1, 2), beam_points(scenario, run, 3).reshape(-1, 2)])
    canvas = Canvas(240, 200, points.min(axis=0), points.max(axis=0), 11, 40)
    draw_path(canvas, run)
    draw_arms(canvas, scenario, run.slice(row, row + 1))
    draw_beam(canvas, run, row, factor)
    canvas.text(canvas.width - 6, 12, f"deflection drawn × {number_text(factor)}", anchor="end")
    if scenario.gravity:
        canvas.line(np.array([[12.0, 8], [12, 34], [8, 28], [12, 34], [16, 28]]), GRAY, 2)
        canvas.text(20, 26, "g")
    draw_curve(canvas, run, CURVES.get(name, DEFLECTION))
    return canvas.svg(scenario.title)


def draw_overview() -> str:
    """The guide's picture with labels: the controller is slow, so that pose and desired pose differ."""
    lazy = {"controller.feedback_gain": 60.0, "controller.sliding_slope": 8.0, "payload.bending_stiffness": 10.0}
    scenario = load_preset("paper").replace(lazy)
    run = simulate(scenario, 1.0, 0.001)
    row = 130
    now = run.slice(row, row + 1)
    canvas = Canvas(300, 226, np.array([-1.02, -0.1]), np.array([1.02, 1.12]), 8, 14)
    draw_path(canvas, run)
    ghost = canvas.at(link_points(scenario, now.desired_pose)[0])
    canvas.line(ghost, DESIRED, 3)
    draw_arms(canvas, scenario, now)
    link = canvas.at(link_points(scenario, now.pose)[0])
    beam = canvas.at(beam_points(scenario, now, 33, OVERVIEW_FACTOR)[0])
    canvas.line(link, "currentColor", 1, 'stroke-dasharray="4 3"')
    canvas.line(beam, BEAM, 4)
    arms = canvas.at(arm_points(scenario, now)[0])

    def note(words: str, word: tuple[float, float], point: np.ndarray, color: str = "currentColor") -> None:
        """Words around px `word`, with a thin line of `color` from them to `point`."""
        canvas.text(*word, words, "currentColor", "middle", GUIDE_TEXT)
        away = 4 if point[1] > word[1] else -12
        canvas.line(np.array([[word[0], word[1] + away], point]), color, 0.7)

    for base, words in zip(arms[:, 0], ("left arm", "right arm"), strict=True):
        canvas.text(base[0], base[1] + 22, words, "currentColor", "middle", GUIDE_TEXT)
    note("grip", (link[0, 0] - 22, link[0, 1] - 26), link[0])
    note("desired pose", (ghost[1, 0] + 20, ghost[1, 1] - 26), ghost[0] + 0.85 * (ghost[1] - ghost[0]), DESIRED)
    note("virtual link", (link[1, 0] - 4, link[1, 1] + 48), link[0] + 0.8 * (link[1] - link[0]))
    note(f"beam, deflection × {OVERVIEW_FACTOR}", (136, link[1, 1] + 72), beam[12], BEAM)
    return canvas.svg("Two arms carry a beam")


if __name__ == "__main__":
    (ASSETS / "pictures").mkdir(exist_ok=True)
    for name in sorted(file.stem for file in presets_folder().glob("*.json")):
        (ASSETS / "pictures" / f"{name}.svg").write_text(draw_preset(name), encoding="utf-8")
    (ASSETS / "guide" / "pictures").mkdir(exist_ok=True)
    (ASSETS / "guide" / "pictures" / "overview.svg").write_text(draw_overview(), encoding="utf-8")
