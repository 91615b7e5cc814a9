"""The environment moves as the engine, many worlds move as single ones, and Gymnasium's checker finds nothing wrong."""

import ast
import copy
import pickle
import subprocess
import sys
import urllib.request
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeGuard

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import flexlab
import flexlab.gym_environment as gym_environment
from flexlab.errors import StudyError
from flexlab.gym_environment import OBSERVATION, TwoArms, TwoArmsVector
from flexlab.gym_environment.worlds import RULES
from flexlab.lab.scene.cameras import floor_extent
from flexlab.presets import load_preset
from flexlab.sim.world import World
from flexlab.views import GREEN

STILL = {"start_spread": (0.0, 0.0, 0.0), "duration": 0.2}
"""A short episode that begins on the path."""
SAMPLED = load_preset("paper").replace({"controller.kind": "joint-pd"}).replace({"controller.control_period": 0.001})


@pytest.fixture(scope="module")
def torques() -> tuple[np.ndarray, np.ndarray]:
    """Run of a sampled law: held torques (N, 6), N·m, and resulting poses and mid-span deflections (N, 4), m and rad."""
    scenario = SAMPLED.replace({"simulation.integrator": "etdrk4", "simulation.step": 1e-3})
    run = World(scenario).run(100)
    return run.joint_torque[:-1].reshape(-1, 6), np.column_stack([run.pose, run.midspan_deflection])[1:]


def motion(envs: TwoArmsVector | TwoArms, actions: np.ndarray) -> np.ndarray:
    """Poses and deflections of the first world under actions, (N, 4)."""
    found = []
    for action in actions:
        envs.step(np.tile(action, (envs.worlds.count, 1)) if isinstance(envs, TwoArmsVector) else action)
        row = envs.worlds.state
        found.append([*row.y[0, :3], envs.worlds.samples().midspan_deflection[0]])
    return np.array(found)


def test_torques_move_the_world_as_the_engine_does(torques: tuple[np.ndarray, np.ndarray]):
    applied, wanted = torques
    env = TwoArms(action="torques", torque_limit=2000.0, **STILL)
    env.reset(seed=0)
    np.testing.assert_allclose(motion(env, applied / 2000.0), wanted, rtol=0, atol=1e-12)


def test_delayed_actions_act_that_many_periods_later(torques: tuple[np.ndarray, np.ndarray]):
    applied, _ = torques
    late = TwoArmsVector(2, action="torques", torque_limit=2000.0, delay=(2, 2), **STILL)
    late.reset(seed=0)
    # Both have their motors off for two periods, one because its actions are late.
    prompt = TwoArms(action="torques", torque_limit=2000.0, **STILL)
    prompt.reset(seed=0)
    waits = np.vstack([np.zeros((2, 6)), applied[:48] / 2000.0])
    np.testing.assert_array_equal(motion(late, applied[:50] / 2000.0), motion(prompt, waits))


def test_gymnasium_finds_nothing_wrong():
    env = gymnasium.make(gym_environment.ID, stiffness=(20, 400), delay=(0, 3), noise=1.0, variants=3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*Box observation space.*infinity.*")
        check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (sum(len(units) for _, units in OBSERVATION),)


def test_many_worlds_move_on_all_threads_as_one_does():
    options = {"stiffness": (20, 400), "variants": 4, "delay": (0, 2), "noise": 1.0, "duration": 0.05}
    envs = gymnasium.make_vec(gym_environment.ID, num_envs=64, **options)
    assert isinstance(envs, TwoArmsVector)
    seen, _ = envs.reset(seed=5)
    assert seen.shape == (64, 14)
    state = envs.worlds.state
    assert len(set(state.variant)) == 4
    assert set(state.delay) == {0, 1, 2}
    assert min(len(set(state.noise)), len(set(state.seed))) == 64
    assert (state.offset.min(axis=0) < 0).all()
    assert (state.offset.max(axis=0) > 0).all()
    np.testing.assert_allclose(np.diff(np.log(envs.worlds.stiffness)), np.log(20) / 3)
    actions = envs.action_space.sample() * 0.2
    np.testing.assert_array_equal(envs.reset(seed=[5, *[None] * 63])[0], seen)
    again = TwoArms(**options)
    told = [again.reset(seed=seed)[1]["stiffness"] for seed in range(8)]
    assert set(told) <= set(envs.worlds.stiffness)
    assert len(set(told)) > 1
    one, chosen = again.worlds.state, 37
    for name in ("variant", "delay", "seed", "noise", "offset", "y", "observation", "tick"):
        getattr(one, name)[0] = getattr(state, name)[chosen]
    for _ in range(20):
        seen, reward, *_ = envs.step(actions)
        single, single_reward, *_ = again.step(actions[chosen])
        np.testing.assert_array_equal(seen[chosen], single)
        assert reward[chosen] == single_reward


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("count", [None, 40])
def test_a_copy_goes_on_by_itself_as_the_original_does(copied: Callable[[Any], Any], count: int | None):
    """As planners look ahead: a step of the copy moved the original, and gave the copy's old observation."""
    options: dict[str, Any] = {"stiffness": (20, 400), "variants": 2, "delay": (1, 2), "noise": 1.0, "duration": 0.02}
    env = TwoArms(**options) if count is None else TwoArmsVector(count, threads=2, **options)
    env.reset(seed=3)
    actions = [0.2 * env.action_space.sample() for _ in range(30)]
    for action in actions[:5]:
        env.step(action)
    other = copied(env)
    ahead = [other.step(action)[:4] for action in actions[5:]]
    for action, seen in zip(actions[5:], ahead, strict=True):
        for now, before in zip(env.step(action)[:4], seen, strict=True):
            np.testing.assert_array_equal(now, before)
    other.close()
    env.close()


def test_an_episode_that_is_over_restarts_at_the_next_step():
    envs = TwoArmsVector(20, duration=0.003, stiffness=(50, 200), variants=5)
    envs.reset(seed=1)
    nothing = np.zeros((20, 3))
    ends = [envs.step(nothing)[3].all() for _ in range(4)]
    assert ends == [False, False, True, False]
    assert (envs.worlds.state.tick == 0).all()
    seen, reward, failed, over, _ = envs.step(nothing)
    assert (envs.worlds.state.tick == 1).all()
    assert not (failed | over).any()
    assert (reward < 0).all()
    assert np.isfinite(seen).all()


def test_a_failed_episode_terminates_and_costs_its_remaining_time():
    env = TwoArms(duration=2.0, **{"start_spread": (0.0, 0.0, 0.0)})
    env.reset(seed=0)
    for _ in range(2000):
        seen, reward, failed, over, _ = env.step(np.array([1.0, 1.0, 0.0]))
        if failed or over:
            break
    assert (failed, over) == (True, False)
    assert reward < -10
    assert np.isfinite(seen).all()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"action": "force"}, "is not one of 'wrench' or 'torques'"),
        ({"stiffness": (200, 50)}, "is not a range"),
        ({"stiffness": (-1, 50)}, r"stiffness = \(-1, 50\) N·m² is outside the allowed range"),
        ({"delay": (0, 500)}, r"delay = \(0, 500\) control periods is outside the allowed range 0 to"),
        ({"control_period": float("nan")}, "control_period = nan needs a finite number"),
        ({"duration": 0.0}, "duration = 0 s is outside the allowed range"),
        ({"duration": 1e-4}, "duration = 0.0001: it is shorter than a control period"),
        ({"threads": 0}, "threads = 0 is outside the allowed range 1 to"),
        ({"start_spread": (2.0, 0.0, 0.0)}, r"start_spread = \(2.0, 0.0, 0.0\) m, m, rad is outside the allowed range"),
        ({"start_spread": 0.1}, "start_spread = 0.1 needs a list of numbers"),
        ({"stiffness": 100}, "stiffness = 100 needs a list of numbers"),
        ({"stiffness": (50, 100, 200)}, "stiffness = .* needs 2 numbers"),
        ({"stifness": (50, 200)}, "no option stifness: did you mean stiffness"),
        ({"colour": 1}, "no option colour: choose among scenario, action"),
        ({"period": 0.01}, "no option period: choose among scenario, action, control_period"),
        ({"render_mode": "ansi"}, "render_mode = 'ansi' is not known: choose human, rgb_array or None"),
        ({"version": 7}, "version = 7 is not one of 0 or 1"),
        ({"version": []}, "version = .* is not one of 0 or 1"),
        ({"action": np.zeros(2)}, "action = .* is not one of 'wrench' or 'torques'"),
        ({"control_period": 10**400}, "control_period = a number with too many digits needs a finite number"),
        ({"delay": (0, 1.5)}, "delay.1 = 1.5 needs a whole number"),
        ({"delay": np.array([0.0, 2.5])}, "delay.1 = 2.5 needs a whole number"),
        ({"variants": 2.5}, "variants = 2.5 needs a whole number"),
        ({"threads": 1.5}, "threads = 1.5 needs a whole number"),
        ({"scenario": float("nan")}, "float is not a scenario: give a Scenario"),
        ({"scenario": (float("nan"), 1)}, "tuple is not a scenario: give a Scenario"),
    ],
)
def test_unusable_options_are_refused(options: dict, says: str):
    with pytest.raises(StudyError, match=says):
        TwoArms(**options)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (
            [0.0, np.nan, 0.0],
            r"action\[1\] = nan is not usable: give numbers from -1 to 1 of shape \(3,\) \(force x, force y, moment",
        ),
        ([0.0, 0.0], r"An action of shape \(2,\) is not usable: give numbers"),
        ("north", "action = 'north' is not usable: give numbers from -1 to 1"),
        (None, "action = None is not usable: give numbers from -1 to 1"),
        ([1j, 0.0, 0.0], "action = .* is not usable: give numbers from -1 to 1"),
        ([10**400, 0.0, 0.0], "action = .* is not usable: give numbers from -1 to 1"),
        ([[0.0], [0.0, 1.0]], "action = .* is not usable: give numbers from -1 to 1"),
    ],
)
def test_an_unusable_action_is_refused_and_moves_nothing(action: object, says: str):
    env = TwoArms(**STILL)
    env.reset(seed=0)
    with pytest.raises(StudyError, match=says):
        env.step(action)
    assert env.worlds.state.tick[0] == 0
    with pytest.raises(StudyError, match=r"action\[1, 2\] = inf"):
        TwoArmsVector(2).step([[0, 0, 0], [0, 0, np.inf]])


@pytest.mark.parametrize("count", [0, -1, None, "3", 2.0, True])
def test_the_number_of_worlds_has_to_be_a_positive_whole_number(count: object):
    with pytest.raises(StudyError, match=r"num_envs = .* is not usable: give a whole number of at least 1"):
        TwoArmsVector(count)  # type: ignore[arg-type]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the free memory")
@pytest.mark.parametrize("count", [10**9, 2**70])
def test_more_worlds_than_the_memory_holds_are_refused(count: int):
    """Numbers of 64 bits raised NumPy's error; smaller ones were accepted, and the system ended the process at the reset."""
    with pytest.raises(
        StudyError, match=rf"num_envs = {count} worlds take .* GB of memory are free: give \d+ or fewer"
    ):
        gymnasium.make_vec(gym_environment.ID, num_envs=count)


def test_a_step_before_a_reset_and_odd_resets_are_refused():
    with pytest.raises(StudyError, match="A world has no episode yet: call reset before step"):
        TwoArms(**STILL).step(np.zeros(3))
    envs = TwoArmsVector(2, **STILL)
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(StudyError, match="A world has no episode yet"):
        envs.step(np.zeros((2, 3)))
    with pytest.raises(StudyError, match="seed has 0 numbers: give one number, or 2"):
        envs.reset(seed=[])
    with pytest.raises(StudyError, match="options = 'all' is not usable"):
        envs.reset(options="all")  # type: ignore[arg-type]
    with pytest.raises(StudyError, match="`reset` has no option 'mask': give reset_mask"):
        envs.reset(options={"mask": np.array([True, False])})
    with pytest.raises(StudyError, match="`reset` has no option 'stiffness': give none"):
        TwoArms(**STILL).reset(options={"stiffness": 50.0})
    envs.reset(seed=1)
    assert np.isfinite(envs.step(np.zeros((2, 3)))[1]).all()


@pytest.mark.filterwarnings("ignore:.*out of date")
def test_released_versions_stay_as_they_are():
    """The versions differ in the wrench of an action of 1, and the newest one's cost is the root of the first one's."""
    old, new = gymnasium.make("flexlab/TwoArms-v0", **STILL), gymnasium.make(gym_environment.ID, **STILL)
    assert gym_environment.ID == "flexlab/TwoArms-v1"
    costs = []
    for env, wrench in ((old, 200.0), (new, 600.0)):
        env.reset(seed=0)
        steps = [env.step(np.array([50.0 / wrench, 0.0, 0.0], np.float32)) for _ in range(20)]
        costs.append([-1000 * float(step[1]) for step in steps])
    np.testing.assert_allclose(np.square(costs[1]), costs[0], rtol=1e-6)


def test_one_world_restarts_while_others_continue():
    envs = TwoArmsVector(3, **STILL)
    envs.reset(seed=2)
    for _ in range(5):
        envs.step(np.zeros((3, 3)))
    before = envs.worlds.state.y.copy()
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert envs.worlds.state.tick.tolist() == [5, 0, 5]
    np.testing.assert_array_equal(envs.worlds.state.y[::2], before[::2])
    with pytest.raises(StudyError, match="give 3 truth values"):
        envs.reset(options={"reset_mask": [True]})
    envs.worlds.state.failed[2] = True
    envs.step(np.zeros((3, 3)))
    assert envs.worlds.state.tick.tolist() == [6, 1, 0], "one that failed begins anew"


def test_a_picture_shows_the_beam_where_it_is():
    envs = TwoArmsVector(2, render_mode="rgb_array", start_spread=(0.05, 0.05, 0.0))
    envs.reset(seed=0)
    for _ in range(2):  # At the start, and on the way.
        pictures = envs.render()
        assert pictures is not None
        x_min, x_max, y_min, y_max = floor_extent(envs.worlds.scenario)
        for picture, pose in zip(pictures, envs.worlds.state.y[:, :3], strict=True):
            height, width, _ = picture.shape
            green = np.argwhere((abs(picture.astype(int) - GREEN) < 30).all(axis=2))
            middle = (green.min(axis=0) + green.max(axis=0) + 1) / 2
            x = x_min + middle[1] / width * (x_max - x_min)
            y = y_max - middle[0] / height * (y_max - y_min)
            np.testing.assert_allclose([x, y], pose[:2], atol=0.01)
        for _ in range(50):
            envs.step(np.full((2, 3), 0.1))


def test_the_human_render_mode_shows_the_scene_at_an_address():
    env = TwoArms(render_mode="human", control_period=0.02)
    env.reset(seed=0)
    window = env._window
    assert window is not None
    with urllib.request.urlopen(window.address) as answer:
        assert answer.status == 200
    for _ in range(4):  # Every second step is drawn.
        env.step(np.array([0.3, 0.0, 0.0]))
    middle = window.beam.mesh.vertices.mean(axis=0)
    np.testing.assert_allclose(middle[:2], env.worlds.state.y[0, :2], atol=2e-3)
    env.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(window.address)


def test_flexlab_itself_does_not_need_gymnasium():
    program = "import sys, flexlab, flexlab.api, flexlab.cli; print('gymnasium' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_example_learns(root: Path, capsys: pytest.CaptureFixture[str]):
    file = root / "web_assets" / "examples" / "train_two_arms.py"
    source = file.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 31
    assert "GENERATIONS = 64, 10, 12" in source
    exec(compile(source.replace("GENERATIONS = 64, 10, 12", "GENERATIONS = 64, 10, 4"), str(file), "exec"), {})
    medians = [float(line.split("reward")[1].split(",")[0]) for line in capsys.readouterr().out.splitlines()]
    assert medians == sorted(medians)
    assert medians[-1] > 0.85 * medians[0]


def test_a_learnt_law_acts_in_the_lab_as_in_the_environment(root: Path, tmp_path: Path):
    """The law that the example writes, with a random network, observes and does the same as in the environment."""
    source = (root / "web_assets" / "examples" / "learn_by_ppo.py").read_text(encoding="utf-8")
    values = {node.targets[0].id: node.value for node in ast.parse(source).body if _names_one(node)}
    random = np.random.default_rng(0)
    layers = [
        (random.normal(size=(8, 14)) * 0.3, random.normal(size=8)),
        (random.normal(size=(3, 8)) * 0.2, np.zeros(3)),
    ]
    size, wrench = np.linspace(0.5, 2.0, 14), RULES[1].wrench_scale
    rows = "\n".join(f"    ({weights.tolist()}, {offset.tolist()})," for weights, offset in layers)
    file = tmp_path / "learnt_law.py"
    text = ast.literal_eval(values["LAW"]).format(size=size.tolist(), wrench=list(wrench), layers=rows, period=0.005)
    file.write_text(text, encoding="utf-8")

    env = TwoArms(control_period=0.005, **STILL)
    seen, _ = env.reset(seed=0)
    poses = []
    for _ in range(40):
        hidden = np.tanh(layers[0][0] @ np.clip(seen / size, -10, 10) + layers[0][1])
        seen, *_ = env.step(layers[1][0] @ hidden)
        poses.append(env.worlds.state.y[0, :3].copy())

    limited = load_preset("paper").replace({"controller.torque_limit": (200.0, 200.0, 200.0)})
    run = flexlab.simulate(limited, 0.2, 0.005, law=file)
    assert np.ptp(poses, axis=0).max() > 0.01
    np.testing.assert_allclose(run.pose[1:], poses, rtol=0, atol=2e-6)


def _names_one(node: ast.stmt) -> TypeGuard[ast.Assign]:
    return isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
