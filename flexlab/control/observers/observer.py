"""What the observers of the beam share: an estimate of pose, pose rate and lowest modes from pose, pose rate and strain gauges.

The model: the believed plant at the path's centre (`believed_plant`), z = (x, η, ẋ, η̇) over one control period T_c of held
torques, z(k+1) = Φ z(k) + Γ F(k) + Γ_w g cos θ. F (3,) is the force of the held joint torques on the pose less the arms'
velocity terms and all weight, ΣJ̄_iᵀτ_i - ΣC̄_iẋ - ΣḠ_i - (0, m g, 0), at the measured pose; Γ_w: the weight that bends the beam.

    ẑ(k|k-1) = Φ ẑ(k-1) + Γ F(k-1) + Γ_w g cos θ        ẑ(k) = ẑ(k|k-1) + L (y(k) - C ẑ(k|k-1))

y: pose, pose rate, and the strains -½ t w''(s_j). Observers differ in their steady gain L: each is a file of this folder with a
subclass of `Observer`, which scenarios and menus then have.

Feedback of the estimate acts late: by the delay of d periods and, as torques are held, half a period more. The observer therefore
**predicts** with the same model, the torques under way, and after them those that the law asks for now.

Stability: the error's own dynamics are Φ - L C Φ, and if they are stable, so is by the separation principle the loop, if the
plant is the model. A plant has more modes than the model: what the gauges see of them enters the estimate and what the law
answers excites them (spillover: Balas, J. Optim. Theory Appl. 25 (1978) 415). No theorem covers that; the sampled poles of plant,
law and observer show it (`flexlab.modes`).
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import field_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import inlined
from flexlab.control.law import Memory
from flexlab.control.observers.believed_plant import BelievedPlant, believed_plant, hold
from flexlab.numerics.linear_algebra import product
from flexlab.numerics.matrix_functions import exponential
from flexlab.physics.arm import task_input
from flexlab.physics.law_input import MOST_DELAY, MOST_GAUGES
from flexlab.quantities import Part
from flexlab.registry import modules_in

MOST_MODES = 8
"""Most modes that can be observed: as many as gauges, since further modes cannot be distinguished."""
STATES, READINGS = 2 * (3 + MOST_MODES), 6 + MOST_GAUGES
"""Room for z and y in the record of constants."""
ESTIMATE = "observer"
"""Name of the memory that holds ẑ(k), and whether there is one."""


class Observer(Part):
    """Base of all observers; subclasses declare these fields, and those of their gain."""

    if TYPE_CHECKING:
        kind: Any  # Each observer's own name, a Literal.
        observer_modes: int
        gauges: tuple[float, ...]
        horizon: float | None

    @field_validator("gauges", check_fields=False)
    @classmethod
    def _few(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not 1 <= len(value) <= MOST_GAUGES:
            raise PydanticCustomError("numbers", "needs {low} to {high} numbers", {"low": 1, "high": MOST_GAUGES})
        return value

    def memory(self) -> Memory:
        """ẑ(k), and whether there is one."""
        return Memory(ESTIMATE, 2 * (3 + self.observer_modes) + 1)

    def gain(self, scenario: Any, plant: BelievedPlant, transition: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """L, (2 (3 + n_o), 6 + gauges), for Φ and the input matrix of held forces on pose and modes.

        Raises `ScenarioError` if there is none.
        """
        raise NotImplementedError


def known_observers() -> list[type[Observer]]:
    """The observers of this folder's files."""
    modules_in("flexlab.control.observers")
    return Observer.__subclasses__()


def observer_shapes(rows: int) -> dict[str, tuple[int, ...]]:
    """Fields that the observer adds to a law's record of gains, for `rows` predicted numbers."""
    return {
        "observed_modes": (),
        "period": (),
        "transition": (STATES, STATES),
        "force_input": (STATES, 3),
        "weight_input": (STATES,),
        "observer_gain": (STATES, READINGS),
        "strain_rows": (MOST_GAUGES, MOST_MODES),
        "prediction": (rows, STATES),
        "force_prediction": (MOST_DELAY + 1, rows, 3),
        "weight_prediction": (rows,),
        "predicted_periods": (),
    }


def padded(value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The array padded with zeros to a shape."""
    whole = np.zeros(shape)
    whole[tuple(slice(0, size) for size in np.shape(value))] = value
    return whole


def observer_constants(
    scenario: Any, observer: Observer, rows_of: Callable[[BelievedPlant], np.ndarray], horizon: float
) -> dict[str, Any]:
    """The `observer_shapes` fields of a scenario, to predict rows_of(plant) ẑ, (rows, 2 (3 + n_o)), `horizon` periods ahead.

    Raises `ScenarioError` if there is no steady gain.
    """
    period, n = scenario.controller.control_period, observer.observer_modes
    plant = believed_plant(scenario, n, observer.gauges)
    A, B = plant.state_matrix, plant.input_matrix
    weight = product(B[:, 3:], -plant.h[:, None])
    transition, inputs = hold(A, np.hstack([B, weight]), period)
    rows = rows_of(plant)
    whole = int(np.ceil(horizon))
    by_force = np.zeros((MOST_DELAY + 1, len(rows), 3))
    for k in range(whole):
        part = min(1.0, horizon - k)
        later = exponential(A * (horizon - k - part) * period)
        by_force[k] = product(product(rows, later), hold(A, B[:, :3], part * period)[1])
    ahead, weighed = hold(A, weight, horizon * period)
    gain = observer.gain(scenario, plant, transition, inputs[:, : 3 + n])
    return {
        "observed_modes": n,
        "period": period,
        "transition": padded(transition, (STATES, STATES)),
        "force_input": padded(inputs[:, :3], (STATES, 3)),
        "weight_input": padded(inputs[:, -1], (STATES,)),
        "observer_gain": padded(gain, (STATES, READINGS)),
        "strain_rows": padded(plant.strain, (MOST_GAUGES, MOST_MODES)),
        "prediction": padded(product(rows, ahead), (len(rows), STATES)),
        "force_prediction": by_force,
        "weight_prediction": product(rows, weighed[:, 0]),
        "predicted_periods": whole,
    }


@inlined
def net_force(now, place, force, u):
    """Fill force (3,) with the force of the torques now.torque[place] on the pose, less velocity terms and weight.

    place < 0: with the force of now.u. u: scratch (3,).
    """
    for a in range(3):
        force[a] = 0.0
    for i in range(now.arm_count):
        if place >= 0:
            task_input(now.J[i], now.torque[place, i], u)
        else:
            for a in range(3):
                u[a] = now.u[i, a]
        for a in range(3):
            total = u[a] - now.G[i, a]
            for b in range(3):
                total -= now.C[i, a, b] * now.v[b]
            force[a] += total
    force[1] -= now.m * now.gravity


@inlined
def update_estimate(gains, now, memory, estimate):
    """Fill estimate with ẑ(k) from the memory of the instant before.

    At the first instant the estimate starts from the measured pose and rate, and modes at rest.
    """
    n = 3 + int(gains.observed_modes)
    force, error = now.scratch[0], now.scratch[2:7]
    if memory[2 * n] < 0.5:
        for k in range(2 * n):
            estimate[k] = 0.0
        for a in range(3):
            estimate[a], estimate[n + a] = now.x[a], now.v[a]
    else:
        net_force(now, 0, force, now.scratch[1])
        weight = now.gravity * now.trig[0]
        for k in range(2 * n):
            total = gains.weight_input[k] * weight
            for a in range(3):
                total += gains.force_input[k, a] * force[a]
            for j in range(2 * n):
                total += gains.transition[k, j] * memory[j]
            estimate[k] = total
    for a in range(3):
        error[0, a], error[1, a] = now.x[a] - estimate[a], now.v[a] - estimate[n + a]
    for j in range(now.gauge_count):
        total = now.strain[j]
        for k in range(n - 3):
            total -= gains.strain_rows[j, k] * estimate[3 + k]
        error[2 + j // 3, j % 3] = total
    for k in range(2 * n):
        total = 0.0
        for j in range(6 + now.gauge_count):
            total += gains.observer_gain[k, j] * error[j // 3, j % 3]
        estimate[k] += total


@inlined
def predict(gains, now, estimate, predicted):
    """Fill predicted (rows,), with the torques under way and then those of now.u."""
    force = now.scratch[0]
    weight = now.gravity * now.trig[0]
    for r in range(len(gains.prediction)):
        total = gains.weight_prediction[r] * weight
        for k in range(2 * (3 + int(gains.observed_modes))):
            total += gains.prediction[r, k] * estimate[k]
        predicted[r] = total
    for k in range(int(gains.predicted_periods)):
        net_force(now, k + 1 if k < now.delay else -1, force, now.scratch[1])
        for r in range(len(gains.prediction)):
            for a in range(3):
                predicted[r] += gains.force_prediction[k, r, a] * force[a]


@inlined
def remember(gains, memory, estimate):
    """Turn the estimate into the rate that brings the memory to it within one control period."""
    last = 2 * (3 + int(gains.observed_modes))
    for k in range(last):
        estimate[k] = (estimate[k] - memory[k]) / gains.period
    estimate[last] = (1.0 - memory[last]) / gains.period
