"""Learns a linear control law for the two arms by the cross-entropy method: 64 worlds at once, each with its own beam."""

import gymnasium
import numpy as np

import flexlab.gym_environment

WORLDS, KEPT, GENERATIONS = 64, 10, 12
SIZE = np.repeat([20.0, 2.0, 0.4], 3)  # scale of the gains of e, ė and ẍ_d, for x, y and θ

envs = gymnasium.make_vec(flexlab.gym_environment.ID, num_envs=WORLDS, duration=0.5, stiffness=(50, 200))
random = np.random.default_rng(0)
mean, spread = np.zeros(9), SIZE

for generation in range(GENERATIONS):
    gains = mean + spread * random.normal(size=(WORLDS, 9))
    seen, _ = envs.reset(seed=generation)
    total, running = np.zeros(WORLDS), np.ones(WORLDS, bool)
    while running.any():
        actions = (gains * seen[:, :9]).reshape(WORLDS, 3, 3).sum(axis=1)  # per axis, the weighted sum of e, ė and ẍ_d
        seen, reward, failed, over, _ = envs.step(actions)
        total += reward * running
        running &= ~(failed | over)
    best = gains[np.argsort(total)[-KEPT:]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02 * SIZE
    print(f"generation {generation + 1:2}: median reward {np.median(total):7.2f}, best {total.max():7.2f}")
envs.close()
