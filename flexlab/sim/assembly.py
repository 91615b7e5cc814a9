"""Everything that is derived from a scenario once and then only used: kernel constants, integrator, sampling."""

from typing import NamedTuple

import numpy as np

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
    # A strain gauge's noise reaches hᵀq̇ and gᵀq̇ in proportion to the loads they weigh.
    strain = noise.strain * np.array([beam.matrices.m, beam.matrices.m * scenario.payload.length])
    sampling = Sampling(
        law.control_period or 0.0,
        max(per_control, 1),
        law.input_delay,
        np.concatenate([noise.pose, noise.pose_rate, strain]).astype(float),
        noise.seed,
        np.zeros((law.input_delay + 1, len(scenario.arms), 3)),
    )
    return Assembly(beam, system, sampling, build_scheme(integrator, beam, tick_period / count), count, integrator)
