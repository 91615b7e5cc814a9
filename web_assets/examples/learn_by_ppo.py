"""Learns a control law for the two arms by proximal policy optimisation, and writes it into a file for the lab.

pip install "flexlab[learn]" installs Stable-Baselines3. Learning takes four to eight minutes on two cores. In the leaderboard's
case B1 the learnt law then has an RMS error of 0.3 to 0.5 mm, depending on the version of torch, and `pd` one of 10.9 mm.
To enter it there: flexlab leaderboard --law learnt_law.py
"""

import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import flexlab.gym_environment
from flexlab.gym_environment.worlds import RULES

WORLDS, PERIODS, STEPS = 64, 200, 6_000_000
OPTIONS = {"control_period": 0.005, "duration": 1.0, "stiffness": (50, 200)}
SIZE = np.array([0.02] * 3 + [0.4] * 3 + [8.0] * 3 + [0.5, 0.1] + [0.5] * 3, np.float32)  # of usual observations
REWARD = 0.2  # scaled so that a good second costs about as much as a poor prediction of it
P, D = 20000.0, 800.0  # the gains of `pd`
WRENCH = np.array(RULES[1].wrench_scale)  # N, N, N·m


def scaled(seen):
    return np.clip(seen / SIZE, -10, 10)


class Worlds(VecEnv):
    """The environment as Stable-Baselines3 needs it: a world whose episode ends restarts at once."""

    def __init__(self):
        self.envs = gymnasium.make_vec(flexlab.gym_environment.ID, num_envs=WORLDS, **OPTIONS)
        super().__init__(WORLDS, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self):
        return scaled(self.envs.reset(seed=0)[0])

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, reward, failed, over, _ = self.envs.step(self.actions)
        ended, notes = failed | over, [{} for _ in range(WORLDS)]
        if ended.any():
            for k in np.flatnonzero(ended):
                notes[k] = {"terminal_observation": scaled(seen[k]), "TimeLimit.truncated": bool(over[k])}
            seen, _ = self.envs.reset(options={"reset_mask": ended})
        return scaled(seen), (REWARD * reward).astype(np.float32), ended, notes

    def close(self):
        self.envs.close()

    def get_attr(self, name, indices=None):
        return [None] * WORLDS

    def set_attr(self, *_):
        raise NotImplementedError

    def env_method(self, *_, **__):
        raise NotImplementedError

    def env_is_wrapped(self, *_):
        return [False] * WORLDS


def reward_of(law):
    """Mean reward of 64 episodes that begin at rest, each with a beam of its own."""
    envs = gymnasium.make_vec(flexlab.gym_environment.ID, num_envs=WORLDS, **OPTIONS)
    seen, _ = envs.reset(seed=1)
    total, running = np.zeros(WORLDS), np.ones(WORLDS, bool)
    while running.any():
        seen, reward, failed, over, _ = envs.step(law(seen))
        total += reward * running
        running &= ~(failed | over)
    envs.close()
    return total.mean()


class Report(BaseCallback):
    """Prints how good the law is so far, ten times."""

    begun = time.monotonic()

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        if self.num_timesteps % (STEPS // 10) < WORLDS * PERIODS:
            reward = reward_of(lambda seen: self.model.predict(scaled(seen), deterministic=True)[0])
            print(f"{self.num_timesteps} steps, {time.monotonic() - self.begun:.0f} s: {reward:.2f}", flush=True)


LAW = '''"""Learnt by proximal policy optimisation; written by web_assets/examples/learn_by_ppo.py."""

import numpy as np

from flexlab import OwnLaw

SIZE = np.array({size})
WRENCH = np.array({wrench})
LAYERS = [
{layers}
]


class Learnt(OwnLaw):
    """A network of two hidden layers, from what is measured to the wrench on the payload."""

    period = {period}

    def act(self, at):
        now = np.r_[at.pose - at.desired_pose, at.pose_rate - at.desired_rate, at.desired_acceleration, at.beam_rate, at.pose]
        x = np.clip(now / SIZE, -10, 10)
        for number, (weights, offset) in enumerate(LAYERS):
            x = np.array(weights) @ x + offset
            if number < len(LAYERS) - 1:
                x = np.tanh(x)
        return at.shared(WRENCH * np.clip(x, -1, 1))
'''


def write_law(policy, file):
    """Write the network as an own law, for flexlab --law FILE."""
    linear = [each for each in policy.mlp_extractor.policy_net if isinstance(each, torch.nn.Linear)] + [
        policy.action_net
    ]
    parts = [
        np.round(part.detach().numpy().astype(float), 5).tolist()
        for each in linear
        for part in (each.weight, each.bias)
    ]
    layers = "\n".join(f"    ({weights}, {offset})," for weights, offset in zip(parts[::2], parts[1::2], strict=True))
    size, period = np.round(SIZE.astype(float), 3).tolist(), OPTIONS["control_period"]
    Path(file).write_text(LAW.format(size=size, wrench=WRENCH.tolist(), layers=layers, period=period), encoding="utf-8")


def main():
    torch.set_num_threads(1)
    print(f"pd: {reward_of(lambda seen: -(P * seen[:, :3] + D * seen[:, 3:6]) / WRENCH):.2f}", flush=True)
    learner = PPO(
        "MlpPolicy",
        Worlds(),
        n_steps=PERIODS,
        batch_size=WORLDS * PERIODS // 8,
        gamma=0.95,
        learning_rate=lambda left: 1e-3 * max(left, 0.03),
        target_kl=0.03,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.5},
        seed=0,
    )
    learner.learn(STEPS, callback=Report())
    write_law(learner.policy, "learnt_law.py")


if __name__ == "__main__":
    main()
