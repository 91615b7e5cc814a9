"""The environment as Gymnasium knows it, for one world and for many.

An action is what the motors do for one control period (zero-order hold), in [-1, 1]:
    action="wrench": force (x, y) and moment on the payload over WRENCH_SCALE, N, N, N·m; the arms share it, and each turns its
        share into joint torques at the present pose, u_i = 𝒥_iᵀτ_i;
    action="torques": joint torques of the left, then the right arm, over the torque limit.
An observation is OBSERVATION in SI units: what a sampled controller measures, with its noise, and where the path leads.
The reward of a period T_c is -T_c · min(100, c), with
    c = (e_x² + e_y²)/(10 mm)² + e_θ²/(20 mrad)² + (w - w_qs)²/(1 mm)² + 0.01 Σ (τ/τ_max)²,
w - w_qs the vibration at mid-span. Where an arm can no longer reach, or the beam bends by its length, the episode terminates, and
every second left costs 100. Otherwise it is truncated after `duration`.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flexlab.gym_environment.kernels import OBSERVED
from flexlab.gym_environment.worlds import WRENCH, Settings, WorldBatch

OBSERVATION = (
    ("tracking error e", ("m", "m", "rad")),
    ("its rate ė", ("m/s", "m/s", "rad/s")),
    ("desired acceleration ẍ_d", ("m/s²", "m/s²", "rad/s²")),
    ("moment rates hᵀq̇, gᵀq̇ of the beam", ("kg·m/s", "kg·m²/s")),
    ("pose x", ("m", "m", "rad")),
)
"""What is observed, in this order, with the unit of each number."""
WRENCH_SCALE = np.array([200.0, 200.0, 50.0])
"""N, N, N·m of a wrench of 1."""


class _Scaled:
    """What one world and many have in common."""

    def _make(self, count: int, options: dict[str, Any]) -> None:
        self.settings = Settings(**options)
        self.worlds = WorldBatch(self.settings, count)
        torques = np.full(self.worlds.action_size, float(self.settings.torque_limit))
        self._scale = WRENCH_SCALE if self.settings.action == WRENCH else torques
        self.one_observation = gym.spaces.Box(-np.inf, np.inf, (OBSERVED,), np.float32)
        self.one_action = gym.spaces.Box(-1.0, 1.0, (len(self._scale),), np.float32)

    def _scaled(self, actions: Any) -> np.ndarray:
        """Actions in [-1, 1] as N and N·m, (worlds, numbers)."""
        shaped = np.asarray(actions, dtype=float).reshape(self.worlds.count, len(self._scale))
        return np.minimum(np.maximum(shaped, -1.0), 1.0) * self._scale


class TwoArms(gym.Env[np.ndarray, np.ndarray], _Scaled):
    """One world; arguments as `worlds.Settings`. `info` says the stiffness (N·m²) and the delay of the episode."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **options: Any):
        self.render_mode = render_mode
        self._make(1, options)
        self.observation_space, self.action_space = self.one_observation, self.one_action

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        self.worlds.begin(np.ones(1, bool), self.np_random)
        return self.worlds.state.observation[0].copy(), self._info()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold an action for one control period."""
        state = self.worlds.state
        state.pause[:] = False
        self.worlds.step(self._scaled(action))
        seen = state.observation[0].copy()
        return seen, float(state.reward[0]), bool(state.failed[0]), bool(state.over[0]), self._info()

    def _info(self) -> dict[str, Any]:
        state = self.worlds.state
        return {"stiffness": float(self.worlds.stiffness[state.variant[0]]), "delay": int(state.delay[0])}

    def close(self) -> None:
        """End the threads."""
        self.worlds.close()


class TwoArmsVector(VectorEnv[np.ndarray, np.ndarray, np.ndarray], _Scaled):
    """`num_envs` worlds that move in one call; a world whose episode is over begins the next one with the next step."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **options: Any):
        self.num_envs, self.render_mode = num_envs, render_mode
        self._make(num_envs, options)
        self.single_observation_space, self.single_action_space = self.one_observation, self.one_action
        self.observation_space = batch_space(self.one_observation, num_envs)
        self.action_space = batch_space(self.one_action, num_envs)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode in every world."""
        one = seed[0] if isinstance(seed, list) else seed
        super().reset(seed=one)
        self.worlds.begin(np.ones(self.num_envs, bool), self.np_random)
        self.worlds.state.pause[:] = False
        return self.worlds.state.observation.copy(), {}

    def step(self, actions: Any) -> Any:
        """Hold actions for one control period; worlds whose episode was over begin anew instead, with reward 0."""
        state = self.worlds.state
        over = state.failed | state.over
        if over.any():
            self.worlds.begin(over, self.np_random)
        self.worlds.step(self._scaled(actions))
        return state.observation.copy(), state.reward.copy(), state.failed.copy(), state.over.copy(), {}

    def close_extras(self, **_: Any) -> None:
        """End the threads."""
        self.worlds.close()
