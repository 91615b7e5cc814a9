"""Settings of the screen, which do not affect the simulation."""

import math
from dataclasses import dataclass
from typing import Annotated, get_type_hints

from flexlab.guide import HIGHEST_EXAGGERATION
from flexlab.quantities import Quantity
from flexlab.views import FACTOR_DIGITS

EXAGGERATION = Quantity(
    "Exaggeration of the deflection", unit="×", low=0, high=HIGHEST_EXAGGERATION, slider=(1, 1000), logarithmic=True
)
MOST_DRAWN = 0.35
"""Largest drawn deflection while the lab chooses the factor, as a fraction of the beam's length."""
PLOT_WINDOWS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
"""Choices for the plots' time window, s."""
USUAL_WINDOW = 5.0
"""Time that the plots show, wall s."""


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the screen; switches are annotated with their names on it.

    `exaggeration`: factor on the drawn deflection; `plot_window`: s. `follow_deflection`: whether the lab chooses the
    exaggeration for each run; `follow_speed`: whether it chooses the window. `shown_mode`: index of the mode whose shape
    is animated instead of the run, or None.
    """

    exaggeration: float = 50.0
    plot_window: float = USUAL_WINDOW
    follow_deflection: Annotated[bool, "Exaggeration suits each run"] = True
    follow_speed: Annotated[bool, "Plot window follows the speed"] = True
    strain: Annotated[bool, "Strain colours"] = False
    axial: Annotated[bool, "Axial force colours"] = False
    forces: Annotated[bool, "Internal force"] = True
    moments: Annotated[bool, "Internal moment"] = False
    moving_force: Annotated[bool, "Moving force"] = False
    ghost: Annotated[bool, "Desired pose"] = True
    path: Annotated[bool, "Desired path"] = True
    trail: Annotated[bool, "Trail of the payload"] = False
    reach: Annotated[bool, "Reach and singular poses"] = False
    hold_plots: Annotated[bool, "Hold the plots still"] = False
    shown_mode: int | None = None


_HINTS = get_type_hints(ViewSettings, include_extras=True)
SWITCHES = {name: hint.__metadata__[0] for name, hint in _HINTS.items() if hasattr(hint, "__metadata__")}
"""Settings that are on or off → their names on the screen."""


def tamed_exaggeration(factor: float, deflection: float, length: float) -> float:
    """The factor, lowered if the present largest `deflection`, m, of a beam of `length` m would be drawn beyond `MOST_DRAWN`.

    It never rises, so that a ring is seen to die out.
    """
    if factor * deflection <= MOST_DRAWN * length:
        return factor
    highest = MOST_DRAWN * length / deflection
    step = 10.0 ** (math.floor(math.log10(highest)) + 1 - FACTOR_DIGITS)
    return max(step * math.floor(highest / step), 1.0)


def fitting_window(speed: float) -> float:
    """The offered plot window, s, that comes nearest to the usual wall time at a speed."""
    return min(PLOT_WINDOWS, key=lambda window: abs(math.log(window / (USUAL_WINDOW * speed))))


def nice(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / (power * step))))
