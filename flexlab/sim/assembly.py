"""Everything that is derived from a scenario once and then only used: kernel constants, integrator, sampling."""

from typing import NamedTuple

import numpy as np

from flexlab.physics.strain_gauges import gauge_places, load_moments, strain_rows
from flexlab.scenario import Scenario
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import Beam, build_beam, build_system
from flexlab.sim.closed_loop import System
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.sampled_control import Sampling
from flexlab.sim.step_size import build_scheme, choose_step, steps_per_tick


class Assembly(NamedTuple):
    """What is derived from a scenario and a tick period."""

    beam: Beam
    system: System
    sampling: Sampling
    scheme: Scheme
    step_count: int
    """Integration steps per tick."""
    integrator: str


def build_assembly(scenario: Scenario, tick_period: float) -> Assembly:
    """Derive everything from a scenario; raises `ScenarioError`."""
    with one_blas_thread():
        return _derive(scenario, tick_period)


def _derive(scenario: Scenario, tick_period: float) -> Assembly:
    beam = build_beam(scenario.payload)
    system = build_system(scenario, beam)
    integrator, step = choose_step(scenario, system, beam)
    count, per_control = steps_per_tick(scenario, tick_period, step)
    law, noise = scenario.controller, scenario.controller.sensor_noise
    sampling = Sampling(
        law.control_period or 0.0,
        max(per_control, 1),
        law.input_delay,
        np.array([*noise.pose, *noise.pose_rate, *noise.moment_rate]),
        gauge_noise(scenario, beam),
        noise.seed,
        np.zeros((law.input_delay + 1, len(scenario.arms), 3)),
    )
    return Assembly(beam, system, sampling, build_scheme(integrator, beam, tick_period / count), count, integrator)


def gauge_noise(scenario: Scenario, beam: Beam) -> np.ndarray:
    """`Sampling.gauge_noise` of a scenario, (2, gauges): σ_ε W / T_c; (2, 0) where nothing is noisy or nothing sampled."""
    law, payload = scenario.controller, scenario.payload
    if law.control_period is None or law.sensor_noise.strain == 0:
        return np.zeros((2, 0))
    places, weights = gauge_places(payload.length)
    rows = strain_rows(places, payload.length, payload.thickness, payload.element_count, payload.boundary)
    moments = load_moments(beam.matrices, payload.bending_stiffness, payload.thickness, weights, rows)
    return np.ascontiguousarray(law.sensor_noise.strain / law.control_period * moments)
