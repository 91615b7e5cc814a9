"""The motion that is asked for."""

from typing import Literal

from flexlab.quantities import Part, Triple, quantity


class SineTrajectory(Part):
    """x_d(t) = center + amplitude · sin(2π frequency t + phase), for x, y and θ (Section IV of the paper)."""

    kind: Literal["sine"] = "sine"
    center: Triple = quantity(
        (0.0, 0.75, 0.0), title="Centre (x, y, θ)", symbol="x_c", unit="m, m, rad", low=-20, high=20
    )
    amplitude: Triple = quantity(
        (0.2, 0.2, 0.2), title="Amplitude (x, y, θ)", symbol="A_d", unit="m, m, rad", low=-5, high=5, slider=(0, 0.4)
    )
    frequency: Triple = quantity(
        (1.0, 1.0, 1.0), title="Frequency", symbol="f_d", unit="Hz", low=0, high=50, slider=(0.1, 3)
    )
    phase: Triple = quantity((0.0, 0.0, 0.0), title="Phase", symbol="φ_d", unit="rad", low=-100, high=100)
