"""The environment is the engine: same torques, same motion; many worlds are many single ones; Gymnasium finds nothing wrong."""

import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import flexlab.gym_environment as gym_environment
from flexlab.errors import StudyError
from flexlab.gym_environment.environment import OBSERVATION, TwoArms, TwoArmsVector
from flexlab.gym_environment.worlds import Settings
from flexlab.presets import load_preset
from flexlab.sim.world import World

STILL = {"start_spread": (0.0, 0.0, 0.0), "duration": 0.2}
"""An episode that begins on the path."""
SAMPLED = load_preset("paper").replace({"controller.kind": "joint-pd"}).replace({"controller.control_period": 0.001})


@pytest.fixture(scope="module")
def torques() -> tuple[np.ndarray, np.ndarray]:
    """(torques held, N·m (N, 6); poses and mid-span deflections that follow, m and rad (N, 4)) of a sampled law's run."""
    scenario = SAMPLED.replace({"simulation.integrator": "etdrk4", "simulation.step": 1e-3})
    run = World(scenario).run(100)
    return run.joint_torque[:-1].reshape(-1, 6), np.column_stack([run.pose, run.midspan_deflection])[1:]


def motion(envs: TwoArmsVector | TwoArms, actions: np.ndarray) -> np.ndarray:
    """Poses and deflections of the first world under actions, (N, 4)."""
    found = []
    for action in actions:
        envs.step(np.tile(action, (envs.worlds.count, 1)) if isinstance(envs, TwoArmsVector) else action)
        row = envs.worlds.state
        found.append([*row.y[0, :3], envs.worlds.deflections()[0]])
    return np.array(found)


def test_torques_move_the_world_as_the_engine_does(torques: tuple[np.ndarray, np.ndarray]):
    applied, wanted = torques
    env = TwoArms(action="torques", torque_limit=2000.0, **STILL)
    env.reset(seed=0)
    np.testing.assert_allclose(motion(env, applied / 2000.0), wanted, rtol=0, atol=1e-12)


def test_late_actions_act_so_many_periods_later(torques: tuple[np.ndarray, np.ndarray]):
    applied, _ = torques
    late = TwoArmsVector(2, action="torques", torque_limit=2000.0, delay=(2, 2), **STILL)
    late.reset(seed=0)
    # Motors that are off for two periods first, whether or not the action is late.
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
    actions = envs.action_space.sample() * 0.2
    again = TwoArms(**options)
    again.reset(seed=0)
    one, chosen = again.worlds.state, 37
    for name in ("variant", "delay", "seed", "noise", "offset", "y", "observation", "tick"):
        getattr(one, name)[0] = getattr(state, name)[chosen]
    for _ in range(20):
        seen, reward, *_ = envs.step(actions)
        single, single_reward, *_ = again.step(actions[chosen])
        np.testing.assert_array_equal(seen[chosen], single)
        assert reward[chosen] == single_reward


def test_an_episode_that_is_over_begins_anew_with_the_next_step():
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


def test_what_cannot_go_on_terminates_and_costs_the_rest():
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
        ({"action": "force"}, "choose wrench or torques"),
        ({"stiffness": (200, 50)}, "is no range"),
        ({"stiffness": (-1, 50)}, "stiffness = -1 is not usable"),
        ({"delay": (0, 500)}, "delay = 500 is not usable"),
        ({"control_period": float("nan")}, "control_period = nan is not usable"),
        ({"duration": 0.0}, "duration = 0.0 is not usable"),
        ({"threads": 0}, "threads = 0 is not usable"),
        ({"start_spread": (2.0, 0.0, 0.0)}, "start_spread = 2.0 is not usable"),
    ],
)
def test_what_is_not_usable_is_said(options: dict, says: str):
    with pytest.raises(StudyError, match=says):
        Settings(**options)


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
