"""The desired motion and its rates."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexlab.scenario import Scenario
from flexlab.sim.build import build_trajectory, desired_at

three = st.tuples(*[st.floats(-3, 3)] * 3)


@settings(max_examples=100, deadline=None)
@given(center=three, amplitude=three, phase=three, frequency=st.tuples(*[st.floats(0, 5)] * 3), t=st.floats(0, 20))
def test_rates_are_the_derivatives_of_the_motion(center, amplitude, phase, frequency, t):
    """x_d = center + amplitude sin(2πft + phase); ẋ_d and ẍ_d by differences; equal and unequal frequencies."""
    path = {"center": center, "amplitude": amplitude, "frequency": frequency, "phase": phase}
    sine = build_trajectory(Scenario().replace({f"trajectory.{name}": value for name, value in path.items()}))
    h = 1e-4
    before, now, after = (desired_at(sine, t + k * h) for k in (-1, 0, 1))
    angle = 2 * np.pi * np.array(frequency) * t + phase
    np.testing.assert_allclose(now[0], np.array(center) + np.array(amplitude) * np.sin(angle), rtol=0, atol=1e-12)
    np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * h), rtol=0, atol=2e-4)
    np.testing.assert_allclose(now[2], (after[1] - before[1]) / (2 * h), rtol=0, atol=1e-2)


def test_components_may_share_motion_or_not():
    """A shared sine for x, y, θ is only taken over where frequency and phase are the same."""
    equal = {"trajectory.frequency": (1.3, 1.3, 1.3), "trajectory.phase": (0.2, 0.2, 0.2)}
    mixed = {"trajectory.frequency": (1.3, 0.7, 1.3), "trajectory.phase": (0.2, 0.2, 0.9)}
    for changes in (equal, mixed):
        scenario = Scenario().replace(changes)
        path = scenario.trajectory
        found = desired_at(build_trajectory(scenario), 0.77)[0]
        angle = 2 * np.pi * np.array(path.frequency) * 0.77 + path.phase
        np.testing.assert_allclose(found, path.center + 0.2 * np.sin(angle), rtol=0, atol=1e-14)
