"""Pictures of a world for programs, drawn flat; people see the lab's scene, `lab.scene.window`."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from flexlab.lab import colors
from flexlab.lab.scene.beam_mesh import STATIONS
from flexlab.lab.scene.stage import floor_extent
from flexlab.lab.view_settings import fitting_exaggeration
from flexlab.number_text import number_text
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points, beam_points
from flexlab.sim.samples import Samples

WIDTH, DPI = 640, 100
"""Of a picture, dots and dots per inch."""


class Drawing:
    """Draws worlds of one scenario flat, seen from above. The deflection is drawn larger by `exaggeration`, as it says."""

    def __init__(self, scenario: Scenario):
        self._scenario, self.exaggeration = scenario, fitting_exaggeration(scenario)
        x_min, x_max, y_min, y_max = floor_extent(scenario)
        height = WIDTH * (y_max - y_min) / (x_max - x_min)
        figure = Figure((WIDTH / DPI, 2 * round(height / 2) / DPI), DPI)
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1), xlim=(x_min, x_max), ylim=(y_min, y_max))
        axes.set_axis_off()
        text = f"deflection drawn × {number_text(self.exaggeration)}"
        axes.text(0.01, 0.99, text, transform=axes.transAxes, ha="left", va="top", color=colors.css(colors.GRAY))
        self._arms = [
            axes.plot([], [], "-o", color=colors.css(color), linewidth=5, markersize=9)[0]
            for color in colors.ARMS[: len(scenario.arms)]
        ]
        self._beam = axes.plot([], [], color=colors.css(colors.GREEN), linewidth=4)[0]

    def picture(self, sample: Samples) -> np.ndarray:
        """(height, width, 3), 0 to 255, of a sample (N = 1)."""
        for line, points in zip(self._arms, arm_points(self._scenario, sample)[0], strict=True):
            line.set_data(*points.T)
        self._beam.set_data(*beam_points(self._scenario, sample, STATIONS, self.exaggeration)[0].T)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
