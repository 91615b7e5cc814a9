"""Energy along whole runs, and the order with which each integrator comes to the solution."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.validation.check import Check, Runs, above, below, close
from flexlab.presets import load_preset
from flexlab.sim.samples import Run
from flexlab.sim.world import World

SUBJECT, PLACE = "Energy and convergence", 4

STEPS = {
    "rk4": (4, (2e-4, 1e-4, 5e-5)),
    "etdrk4": (4, (5e-4, 2.5e-4, 1.25e-4)),
    "generalized-alpha": (2, (2.5e-4, 1.25e-4, 6.25e-5)),
}
"""Integrator → its order, and steps, s."""
RINGING = {"controller.boundary_layer": 10.0, "payload.bending_stiffness": 10.0}
"""The paper's jerk on a beam whose modes all these steps resolve, inside the boundary layer, at whose edge the law has a kink."""
TICK, TICKS = 0.002, 50


def checks(runs: Runs) -> Iterator[Check]:
    """Balance with control and damping, conservation without, orders."""
    run = runs.paper
    moved = float(np.abs(np.diff(run.input_work)).sum() + np.ptp(run.dissipated_energy))
    yield below(
        "paper's run: energy gained = work put in - energy damped, as a part of what moved",
        1e-6,
        imbalance(run) / moved,
    )
    yield above("damping takes energy out, J", 0.0, run.dissipated_energy[-1])
    yield below(
        "and never gives any back: least change, as a part",
        1e-12,
        -np.diff(run.dissipated_energy).min() / run.dissipated_energy[-1],
    )
    free = runs.free
    drift = float(np.abs(free.total_energy / free.total_energy[0] - 1).max())
    yield below("no motors, no damping: relative drift of the energy in 2 s", 1e-6, drift)
    yield above("while the beam holds of it up to", 0.3, free.elastic_energy.max() / free.total_energy[0])
    exact = _end("etdrk4", TICK / 256)
    for integrator, (order, steps) in STEPS.items():
        errors = [np.abs(_end(integrator, step) - exact).max() for step in steps]
        slope = float(np.log2(errors[0] / errors[-1]) / (len(errors) - 1))
        yield close(f"{integrator}: the pose's error falls with the step to the power", order, slope, absolute=0.25)


def imbalance(run: Run) -> float:
    """Largest |ΔE - ∫(power in, with the axial load's and material's, - dissipation, with friction's and grips')|, J."""
    gained, work = run.total_energy, run.input_work + run.axial_work + run.own.get("material_energy", 0.0)
    lost = run.dissipated_energy + run.own.get("friction_loss", 0.0) + run.own.get("grip_loss", 0.0)
    return float(np.abs((gained - gained[0]) - (work - work[0]) + (lost - lost[0])).max())


def _end(integrator: str, step: float) -> np.ndarray:
    changes = {**RINGING, "simulation.integrator": integrator, "simulation.step": step}
    return World(load_preset("paper").replace(changes), TICK).run(TICKS).pose
