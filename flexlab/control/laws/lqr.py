"""The discrete linear-quadratic regulator on pose and the beam's lowest modes, around the rigid feedforward.

    Σu_i = B ẍ_d + C̄ ẋ_d + Ḡ - K (ẑ(k + d) - z_d),    z = (x, η, ẋ, η̇),  z_d = (x_d, 0, ẋ_d, 0) d periods from now

z is estimated and predicted over the input delay of d periods by an observer (`control.observers.observer`), from the same
linear model, that of arms and lowest modes about the path's centre; over a longer horizon, the feedforward stands for the
torques that come after those under way, as K's own are not known yet. K minimises Σ zᵀQz + FᵀRF over the periods: K = (R +
ΓᵀPΓ)⁻¹ΓᵀPΦ, P from the discrete Riccati equation, Q = diag(q_x, q_b ω², q_v, q_b), q_b weighing the beam's energy, and R =
diag(r) (Anderson and Moore, Optimal Control: Linear Quadratic Methods, 1990). Shapes: K (3, 2 (3 + n_o)), N and N·m per m, rad,
m·kg^½ and per second of those. Arms carry their own parts of the feedforward and share the rest. Stability: Φ - ΓK is stable
for any Q ≥ 0, R > 0, and by separation so are regulator, observer and delay together, with V = zᵀPz falling, if the plant is
the model: at the path's centre, for small motions, with these modes alone. The proof leaves out modes that are not
estimated, torque limits and other poses: the sampled poles (`flexlab.modes`) show the stability for each pose and plant, and
`conditions` says whether |λ(Φ − ΓK)| < 1 at the poses of the path. A loop with an observer has no guaranteed margins (Doyle,
IEEE Trans. Automatic Control 23(4), 1978): see its disk margin.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import pluggable
from flexlab.control.conditions import Circumstances, Condition, n
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.control.law_kernels import drive_arms
from flexlab.control.observers.believed_plant import believed_plant, hold
from flexlab.control.observers.kalman import KalmanObserver
from flexlab.control.observers.observer import (
    known_observers,
    observer_constants,
    observer_shapes,
    predict,
    remember,
    update_estimate,
)
from flexlab.errors import ScenarioError
from flexlab.numerics.linear_algebra import NoSolution, inverse, product, singular_vectors, solve
from flexlab.numerics.matrix_functions import discrete_riccati
from flexlab.quantities import Number, Triple, either, quantity

AnyObserver = Any
if not TYPE_CHECKING:
    AnyObserver = either(known_observers())


class LinearQuadratic(Controller):
    """Discrete linear-quadratic regulator on estimated pose and lowest modes, around the rigid feedforward."""

    kind: Literal["lqr"] = "lqr"
    pose_weight: Triple = quantity(
        (1e6, 1e6, 2.5e5), "Weight of the pose's error", "q_x", "1/m², 1/m², 1/rad²", low=1e-6, high=1e12
    )
    pose_rate_weight: Triple = quantity(
        (100.0, 100.0, 25.0), "Weight of its rate", "q_v", "s²/m², s²/m², s²/rad²", low=0, high=1e12
    )
    vibration_weight: Number = quantity(
        1e3, "Weight of the beam's energy", "q_b", "1/J", low=0, high=1e9, slider=(1, 1e5), logarithmic=True
    )
    force_weight: Triple = quantity(
        (1e-4, 1e-4, 1e-2), "Weight of the force", "r", "1/N², 1/N², 1/(N·m)²", low=1e-12, high=1e6
    )
    observer: AnyObserver = quantity(KalmanObserver(), "Observer")

    @model_validator(mode="after")
    def _has_instants(self) -> "LinearQuadratic":
        if self.control_period is None:
            raise PydanticCustomError(
                "sampling",
                "the law lqr acts at control instants: "
                "give the control period (controller.control_period) a value in s, such as 0.001",
            )
        return self


def regulator_gain(scenario: Any) -> np.ndarray:
    """K of a scenario, (3, 2 (3 + n_o)); raises `ScenarioError` where the Riccati equation has no solution."""
    law = scenario.controller
    plant = believed_plant(scenario, law.observer.observer_modes, law.observer.gauges)
    transition, inputs = hold(plant.state_matrix, plant.input_matrix[:, :3], law.control_period)
    beam = np.full(len(plant.omega), law.vibration_weight)
    Q = np.diag(np.concatenate([law.pose_weight, beam * np.square(plant.omega), law.pose_rate_weight, beam]))
    R = np.diag(law.force_weight)
    try:
        P = discrete_riccati(transition, inputs, Q, R)
        pushed = product(inputs.T, P)
        return solve(R + product(pushed, inputs), product(pushed, transition))
    except NoSolution:
        text = (
            "controller: no gain is found for these weights at this control period: observe fewer modes, or take weights "
            "nearer to one another."
        )
        raise ScenarioError([("controller", text)]) from None


def _derive(scenario: Any) -> dict[str, Any]:
    law = scenario.controller
    plant, K = believed_plant(scenario, law.observer.observer_modes, law.observer.gauges), regulator_gain(scenario)
    n, late = len(plant.mass), float(law.input_delay)
    rigid = inverse(plant.mass[:3, :3])
    stiffness, damping = product(rigid, K[:, :3]), product(rigid, K[:, n : n + 3])
    horizon = late if law.observer.horizon is None else law.observer.horizon
    return {
        "reference": np.hstack([K[:, :3], K[:, n : n + 3]]),
        "rate": singular_vectors(damping)[0][-1] + np.sqrt(singular_vectors(stiffness)[0][-1]),
        **observer_constants(scenario, law.observer, lambda _: K, horizon),
    }


@pluggable
def lqr(gains, now, memory, memory_rate, signals):
    """B ẍ_d + C̄ẋ_d + Ḡ - K (ẑ - z_d)."""
    update_estimate(gains, now, memory, memory_rate)
    feedback, desired, coming = now.scratch[7], now.desired, now.coming
    if gains.predicted_periods > now.delay:
        for a in range(3):
            feedback[a] = 0.0
        drive_arms(now, desired[2], desired[1], feedback, now.scratch[3:6])
    predict(gains, now, memory_rate, feedback)
    remember(gains, memory, memory_rate)
    for r in range(3):
        total = -feedback[r]
        for a in range(3):
            total += gains.reference[r, a] * coming[0, a] + gains.reference[r, 3 + a] * coming[1, a]
        feedback[r] = total
    drive_arms(now, desired[2], desired[1], feedback, now.scratch[3:6])


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate of the regulated pose at the path's centre, 1/s."""
    return gains.rate


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """Whether the regulator, designed at one pose, is stable at every pose of the path: |λ(Φ − ΓK)| < 1."""
    scenario = around.scenario
    poses, K = around.path.desired[:, 0], regulator_gain(scenario)
    growth = [_growth(scenario, K, pose) for pose in poses]
    worst = int(np.argmax(growth))
    made_for, there = (", ".join(n(value) for value in pose) for pose in (scenario.trajectory.middle, poses[worst]))
    text = f"|λ(Φ − ΓK)| < 1 on the path: the law is made for one pose, ({made_for}), and at ({there}) its loop "
    if growth[worst] < 0:
        return (Condition(f"{text}decays with {n(-growth[worst])} 1/s.", True),)
    cure = "take a path that turns less, or a law that follows the pose"
    return (Condition(f"{text}grows with {n(growth[worst])} 1/s: {cure}.", False),)


def _growth(scenario: Any, K: np.ndarray, pose: np.ndarray) -> float:
    """Growth rate of the regulated plant's fastest growing state at a pose, 1/s; below 0 if all states decay."""
    law = scenario.controller
    plant = believed_plant(scenario, law.observer.observer_modes, law.observer.gauges, pose.tolist())
    transition, inputs = hold(plant.state_matrix, plant.input_matrix[:, :3], law.control_period)
    return float(np.log(np.abs(np.linalg.eigvals(transition - inputs @ K)).max()) / law.control_period)


def _for_settings(settings: LinearQuadratic) -> Law:
    return replace(LAW, memory=(settings.observer.memory(),))


def _gauges(settings: LinearQuadratic) -> tuple[float, ...]:
    return settings.observer.gauges


LAW = Law(
    LinearQuadratic,
    lqr,
    fastest_rate,
    memory=(),
    constants={"reference": (3, 6), "rate": (), **observer_shapes(rows=3)},
    derive=_derive,
    for_settings=_for_settings,
    gauges=_gauges,
    conditions=conditions,
    relies_on_masses=True,
    place=30,
)
