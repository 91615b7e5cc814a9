"""Threads that wait in machine code give the same motion as one thread, awake or asleep, and none is left behind."""

import gc
import threading

import numpy as np
import pytest
from waiting import wait_until

from flexlab.compiled import PLAIN_PYTHON
from flexlab.gym_environment import TwoArmsVector

pytestmark = pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
OPTIONS = {"stiffness": (20, 400), "variants": 3, "delay": (0, 2), "noise": 1.0, "duration": 0.02}


def standing() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "flexlab-standing"}


def asleep(envs: TwoArmsVector) -> bool:
    """Whether all threads of the environment are asleep."""
    (run,) = [envs.worlds._move.__self__]
    return run._asleep == len(standing())


def made(**options) -> TwoArmsVector:
    envs = TwoArmsVector(48, **OPTIONS, **options)
    envs.reset(seed=3)
    return envs


def test_any_number_of_threads_moves_the_worlds_the_same_whether_or_not_they_slept():
    one, three = made(threads=1), made(threads=3)
    assert len(standing()) == 2, "the first part is the caller's"
    actions = np.random.default_rng(1).uniform(-0.2, 0.2, (40, 48, 3))
    for number, action in enumerate(actions):
        if number % 20 == 10:
            wait_until(lambda: asleep(three), "nobody asks anything of them")
        for mine, other in zip(one.step(action)[:4], three.step(action)[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(one.worlds.state.y, three.worlds.state.y)
    three.close()
    wait_until(lambda: not standing(), "its threads have ended")
    for mine, other in zip(one.step(actions[0])[:4], three.step(actions[0])[:4], strict=True):
        np.testing.assert_array_equal(mine, other)


def test_threads_end_with_an_environment_that_nobody_closed():
    envs = made(threads=2)
    envs.step(np.zeros((48, 3)))
    assert len(standing()) == 1
    del envs
    gc.collect()
    wait_until(lambda: not standing(), "nobody has the environment any more")
