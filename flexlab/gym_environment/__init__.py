"""`flexlab/TwoArms-v1` for Gymnasium (extra `gym`): two arms carry a flexible beam along its path, and you are the control law.

    import flexlab.gym_environment                                    # registers the environment
    env = gymnasium.make("flexlab/TwoArms-v1", stiffness=(20, 400))
    envs = gymnasium.make_vec("flexlab/TwoArms-v1", num_envs=64)      # all worlds in one call of machine code

An action sets the motors for one control period (zero-order hold), in [-1, 1]; numbers beyond count as the limit, as random
policies exceed it now and then:
    action="wrench": force (x, y) and moment on the payload, as shares of 600 N, 600 N, 150 N·m; the arms share it, and each turns
        its share into joint torques at the present pose, u_i = 𝒥_iᵀτ_i;
    action="torques": joint torques of the left, then the right arm, as shares of the torque limit.
An observation is OBSERVATION in SI units: what a sampled controller measures, with its noise, and where the path leads.
The reward of a period T_c is -T_c · min(50, √c), with
    c = (e_x² + e_y²)/(10 mm)² + e_θ²/(20 mrad)² + (w - w_qs)²/(1 mm)² + 0.01 Σ (τ/τ_max)²,
w - w_qs the vibration at mid-span. If an arm can no longer reach, or the beam bends by its length, the episode terminates, and
every second left costs 50. Otherwise it is truncated after `duration`.

Version 0 has a wrench of 200 N, 200 N, 50 N·m, too little for the paper's path, and the reward -T_c · min(100, c): when learning
begins, all costs are at the limit, so that nothing can be learnt from them.

`render_mode="rgb_array"` draws each world, `"human"` shows the first one in a browser.
"""

from typing import Any

try:
    import gymnasium as gym
except ImportError:
    raise ImportError("Gymnasium is not installed: pip install 'flexlab[gym]' brings it.") from None

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from flexlab.arguments import whole_number
from flexlab.errors import StudyError
from flexlab.gym_environment.kernels import OBSERVED
from flexlab.gym_environment.worlds import RULES, WRENCH, Settings, WorldBatch
from flexlab.lab.scene.arms import ARM_COLORS
from flexlab.lab.scene.beam import STATIONS
from flexlab.lab.scene.cameras import floor_extent
from flexlab.lab.scene.scene import PICTURES_PER_SECOND, Window
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points, beam_points
from flexlab.sim.samples import Samples
from flexlab.text import number_text
from flexlab.views import GRAY, GREEN, css, fitting_exaggeration

WIDTH, DPI = 640, 100
"""Width of a picture in dots, and dots per inch."""


class Drawing:
    """Draws worlds of one scenario from above, with the deflection enlarged by `exaggeration`, which the picture states."""

    def __init__(self, scenario: Scenario):
        self._scenario, self.exaggeration = scenario, fitting_exaggeration(scenario)
        x_min, x_max, y_min, y_max = floor_extent(scenario)
        height = WIDTH * (y_max - y_min) / (x_max - x_min)
        figure = Figure((WIDTH / DPI, 2 * round(height / 2) / DPI), DPI)
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1), xlim=(x_min, x_max), ylim=(y_min, y_max))
        axes.set_axis_off()
        text = f"deflection drawn × {number_text(self.exaggeration)}"
        axes.text(0.01, 0.99, text, transform=axes.transAxes, ha="left", va="top", color=css(GRAY))
        self._arms = [
            axes.plot([], [], "-o", color=css(color), linewidth=5, markersize=9)[0]
            for color in ARM_COLORS[: len(scenario.arms)]
        ]
        self._beam = axes.plot([], [], color=css(GREEN), linewidth=4)[0]

    def picture(self, sample: Samples) -> np.ndarray:
        """The picture of a sample (N = 1), (height, width, 3), 0 to 255."""
        for line, points in zip(self._arms, arm_points(self._scenario, sample)[0], strict=True):
            line.set_data(*points.T)
        self._beam.set_data(*beam_points(self._scenario, sample, STATIONS, self.exaggeration)[0].T)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


OBSERVATION = (
    ("tracking error e", ("m", "m", "rad")),
    ("its rate ė", ("m/s", "m/s", "rad/s")),
    ("desired acceleration ẍ_d", ("m/s²", "m/s²", "rad/s²")),
    ("moment rates hᵀq̇, gᵀq̇ of the beam", ("kg·m/s", "kg·m²/s")),
    ("pose x", ("m", "m", "rad")),
)
"""What is observed, in this order, with the unit of each number."""
RENDER_MODES = {"render_modes": ["human", "rgb_array"], "render_fps": PICTURES_PER_SECOND}


class _Scaled:
    """Base of the environments with one world and with many."""

    def _make(self, count: int, render_mode: str | None, options: dict[str, Any]) -> None:
        self.settings = Settings.of(options)
        if render_mode not in (None, *RENDER_MODES["render_modes"]):
            raise StudyError(f"render_mode = {render_mode!r:.60} is not known: choose human, rgb_array or None.")
        self.render_mode = render_mode
        self.worlds = WorldBatch(self.settings, count)
        wrench, torques = self.settings.rules.wrench_scale, [self.settings.torque_limit] * self.worlds.action_size
        self._scale = np.array(wrench if self.settings.action == WRENCH else torques, float)
        self.one_observation = gym.spaces.Box(-np.inf, np.inf, (OBSERVED,), np.float32)
        self.one_action = gym.spaces.Box(-1.0, 1.0, (len(self._scale),), np.float32)
        self._drawing: Drawing | None = None
        self._window: Window | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What a copy takes over: no window, and no figure."""
        return {**vars(self), "_drawing": None, "_window": None}

    def _scaled(self, actions: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Actions, limited to [-1, 1], in N and N·m, (worlds, numbers). Raises `StudyError` for anything else."""
        try:
            given = np.asarray(actions)
            given = given.astype(float) if given.dtype.kind in "biuf" else None
        except (TypeError, ValueError):  # lists of unequal length
            given = None
        if given is None:
            raise StudyError(f"action = {actions!r:.60} is not usable: give {self._numbers(shape)}.")
        if given.shape != shape:
            raise StudyError(f"An action of shape {given.shape} is not usable: give {self._numbers(shape)}.")
        if not np.isfinite(given).all():
            place = np.argwhere(~np.isfinite(given))[0]
            found = f"action[{', '.join(map(str, place))}] = {given[tuple(place)]}"
            raise StudyError(f"{found} is not usable: give {self._numbers(shape)}.")
        return np.minimum(np.maximum(given.reshape(self.worlds.count, len(self._scale)), -1.0), 1.0) * self._scale

    def _numbers(self, shape: tuple[int, ...]) -> str:
        meaning = "force x, force y, moment" if self.settings.action == WRENCH else "joint torques, left arm first"
        return f"numbers from -1 to 1 of shape {shape} ({meaning})"

    def _show(self, passed: float) -> None:
        """Show the first world, `passed` s after it was shown last."""
        if self.render_mode == "human":
            self._window = self._window or Window(self.worlds.scenario)
            self._window.show(self.worlds.samples().take(slice(0, 1)), passed)

    def _draw(self) -> list[np.ndarray]:
        """Pictures of all worlds, (height, width, 3) each."""
        self._drawing = self._drawing or Drawing(self.worlds.scenario)
        samples = self.worlds.samples()
        return [self._drawing.picture(samples.take(slice(k, k + 1))) for k in range(self.worlds.count)]

    def _end(self) -> None:
        self.worlds.close()
        if self._window is not None:
            self._window.close()


MASK = "reset_mask"
"""Gymnasium's name of the option of `reset` that chooses worlds."""


def _checked(options: Any, known: str = "") -> dict[str, Any]:
    """The options of `reset`, of which one is known at most. Raises `StudyError`."""
    if options is not None and not isinstance(options, dict):
        raise StudyError(f"options = {options!r:.60} is not usable: give a dictionary, or None.")
    for name in options or {}:
        if name != known:
            raise StudyError(f"`reset` has no option {name!r:.60}: give {known or 'none'}.")
    return options or {}


class TwoArms(gym.Env[np.ndarray, np.ndarray], _Scaled):
    """One world; arguments as `worlds.Settings`. `info` holds the stiffness (N·m²) and the delay of the episode."""

    metadata = RENDER_MODES

    def __init__(self, render_mode: str | None = None, **options: Any):
        self._make(1, render_mode, options)
        self.observation_space, self.action_space = self.one_observation, self.one_action

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode. There are no options."""
        _checked(options)
        super().reset(seed=seed)
        self.worlds.begin(np.ones(1, bool), self.np_random)
        self._show(1 / PICTURES_PER_SECOND)
        return self.worlds.state.observation[0].copy(), self._info()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold an action for one control period."""
        wrench_or_torques, state = self._scaled(action, self.one_action.shape), self.worlds.state
        state.pause[:] = False
        self.worlds.step(wrench_or_torques)
        self._show(self.settings.control_period)
        seen = state.observation[0].copy()
        return seen, float(state.reward[0]), bool(state.failed[0]), bool(state.over[0]), self._info()

    def _info(self) -> dict[str, Any]:
        state = self.worlds.state
        return {"stiffness": float(self.worlds.stiffness[state.variant[0]]), "delay": int(state.delay[0])}

    def render(self) -> np.ndarray | None:
        """The picture, (height, width, 3), in the mode "rgb_array"."""
        return self._draw()[0] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """End the threads, and the window."""
        self._end()


class TwoArmsVector(VectorEnv[np.ndarray, np.ndarray, np.ndarray], _Scaled):
    """`num_envs` worlds that move in one call; a world whose episode is over begins the next one at the next step."""

    metadata = RENDER_MODES | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **options: Any):
        self.num_envs = whole_number("num_envs", num_envs, 1)
        self._make(self.num_envs, render_mode, options)
        self.single_observation_space, self.single_action_space = self.one_observation, self.one_action
        self.observation_space = batch_space(self.one_observation, self.num_envs)
        self.action_space = batch_space(self.one_action, self.num_envs)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode in every world, or in those of `options["reset_mask"]` (num_envs,).

        All worlds draw from one generator, in their order; of a list of seeds, the first is its seed. World k is not the single
        environment of seed + k.
        """
        if isinstance(seed, list) and len(seed) != self.num_envs:
            usable = f"give one number, or {self.num_envs}, of which the first counts"
            raise StudyError(f"seed has {len(seed)} numbers: {usable}.")
        one = seed[0] if isinstance(seed, list) else seed
        given = _checked(options, MASK)
        super().reset(seed=one)
        chosen = np.asarray(given.get(MASK, np.ones(self.num_envs, bool)))
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool:
            raise StudyError(f"{MASK} is not usable: give {self.num_envs} truth values, one for each world.")
        self.worlds.begin(chosen, self.np_random)
        self.worlds.state.pause[:] = False
        self._show(1 / PICTURES_PER_SECOND)
        return self.worlds.state.observation.copy(), {}

    def step(self, actions: Any) -> Any:
        """Hold actions for one control period; worlds whose episode was over begin anew instead, with reward 0."""
        wrenches_or_torques, state = self._scaled(actions, self.action_space.shape or ()), self.worlds.state
        over = state.failed | state.over
        if over.any():
            self.worlds.begin(over, self.np_random)
        self.worlds.step(wrenches_or_torques)
        self._show(self.settings.control_period)
        return state.observation.copy(), state.reward.copy(), state.failed.copy(), state.over.copy(), {}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The pictures of all worlds in the mode "rgb_array"."""
        return tuple(self._draw()) if self.render_mode == "rgb_array" else None

    def close_extras(self, **_: Any) -> None:
        """End the threads, and the window."""
        self._end()


NAME = "flexlab/TwoArms-v{}"
ID = NAME.format(max(RULES))
"""Name of the newest version; older versions stay available."""

for version in RULES:
    if NAME.format(version) not in gym.registry:
        entry_points = {"entry_point": TwoArms, "vector_entry_point": TwoArmsVector}
        gym.register(NAME.format(version), **entry_points, kwargs={"version": version})
