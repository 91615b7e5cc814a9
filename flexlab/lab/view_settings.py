"""What a person chose to see: settings of the screen only, which the simulation knows nothing of."""

import math
from dataclasses import dataclass

from flexlab.quantities import Quantity
from flexlab.scenario import Scenario

VISIBLE_BENDING = 0.012
"""Share of the beam's length that its ordinary bending is enlarged to when the lab chooses the exaggeration."""
EXAGGERATION = Quantity(
    "Exaggeration of the deflection", unit="×", low=0, high=1000, slider=(1, 1000), logarithmic=True
)
FOLLOWED = 0.05
"""Share of the beam's length that the exaggeration follows the deflection to."""
TOO_LARGE, TOO_SMALL = 0.1, 0.02
"""Shares of the beam's length beyond which the exaggeration is chosen anew."""
PLOT_WINDOWS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
"""Choices for the plots' time window, s."""


USUAL_WINDOW = 5.0
"""Wall seconds that the plots show."""


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the screen. `exaggeration`: factor on the drawn deflection; `plot_window`: s.

    `follow_deflection`: whether the lab chooses the exaggeration; `follow_speed`: whether it chooses the window.
    `shown_mode`: index of the mode whose shape is animated in place of the run, or None.
    """

    exaggeration: float = 50.0
    follow_deflection: bool = True
    follow_speed: bool = True
    strain: bool = False
    forces: bool = True
    moving_force: bool = False
    moments: bool = False
    ghost: bool = True
    path: bool = True
    trail: bool = False
    reach: bool = False
    plot_window: float = USUAL_WINDOW
    hold_plots: bool = False
    shown_mode: int | None = None


@dataclass(frozen=True)
class Legend:
    """What the picture is drawn to. `scales`: (what, how much); `strain`: µm/m at the ends of the colours, 0 without."""

    scales: tuple[tuple[str, str], ...] = ()
    strain: float = 0.0


SWITCHES = {
    "follow_deflection": "Exaggeration follows the deflection",
    "follow_speed": "Plot window follows the speed",
    "strain": "Strain colours",
    "forces": "Internal force",
    "moments": "Internal moment",
    "moving_force": "Moving force",
    "ghost": "Desired pose",
    "path": "Desired path",
    "trail": "Trail of the payload",
    "reach": "Reach and singular poses",
    "hold_plots": "Hold the plots still",
}
"""Settings that are on or off, and their names on the screen."""


def fitting_exaggeration(scenario: Scenario) -> float:
    """A factor of 1, 2 or 5 times a power of ten at which the beam's bending in steady motion is seen but not wild."""
    payload, path = scenario.payload, scenario.trajectory
    load = payload.linear_density * math.hypot(*path.peak_acceleration[:2], scenario.gravity)
    bending = 5 * load * payload.length**4 / (384 * payload.bending_stiffness)
    if bending <= 0:
        return 50.0
    return min(max(nice(VISIBLE_BENDING * payload.length / bending), 1.0), EXAGGERATION.high)


class FollowedExaggeration:
    """Keeps what is drawn of a deflection at a few per cent of the beam's length: less at once, more when it stays small."""

    def __init__(self, patience: int):
        """`patience`: updates in a row that must find the drawn deflection too small."""
        self._patience, self._small_for = patience, 0

    def fit(self, factor: float, deflection: float, length: float) -> float:
        """The factor for the present largest deflection, m, of a beam of `length` m that was drawn by `factor`."""
        share = factor * deflection / length
        self._small_for = self._small_for + 1 if 0 < share < TOO_SMALL else 0
        if share <= TOO_LARGE and self._small_for < self._patience:
            return factor
        self._small_for = 0
        return min(max(nice(FOLLOWED * length / deflection), 1.0), EXAGGERATION.high)


def fitting_window(speed: float) -> float:
    """The plots' window, s, that passes by in the usual wall time at a speed, of those on offer."""
    return min(PLOT_WINDOWS, key=lambda window: abs(math.log(window / (USUAL_WINDOW * speed))))


def nice(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / (power * step))))
