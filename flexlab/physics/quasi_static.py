"""What a motion bends, apart from what rings."""

from flexlab.compiled import inlined
from flexlab.numerics.elementary import sin_cos


@inlined
def quasi_static_deflection(compliance, gravity, desired):
    """w_qs = -N(0) K_F⁻¹ [h (e2_d·a_d + g cos θ_d) + g θ̈_d], m: the load of the desired motion and of the weight, held.

    `desired`: x_d, ẋ_d, ẍ_d (3, 3); `compliance` as in `Plant`. The actual acceleration would not do: it jumps when a motion
    starts or a hand taps, and the jump would pass for vibration.
    """
    s, c = sin_cos(desired[0, 2])
    lateral = c * desired[2, 1] - s * desired[2, 0] + gravity * c
    return compliance[0] * lateral + compliance[1] * desired[2, 2]
