"""`flexlab/TwoArms-v1` for Gymnasium (extra `gym`): two arms carry a flexible beam along its path, and you are the control law.

    import flexlab.gym_environment                                    # registers the environment
    env = gymnasium.make("flexlab/TwoArms-v1", stiffness=(20, 400))
    envs = gymnasium.make_vec("flexlab/TwoArms-v1", num_envs=64)      # all worlds in one call of machine code

`environment.py` describes actions, observations and rewards; `worlds.py` moves the worlds.
"""

try:
    import gymnasium
except ImportError:
    raise ImportError("Gymnasium is not installed: pip install 'flexlab[gym]' brings it.") from None

from flexlab.gym_environment.environment import TwoArms, TwoArmsVector
from flexlab.gym_environment.worlds import RULES

NAME = "flexlab/TwoArms-v{}"
ID = NAME.format(max(RULES))
"""Name of the newest version; older versions stay available."""

for version in RULES:
    if NAME.format(version) not in gymnasium.registry:
        entry_points = {"entry_point": TwoArms, "vector_entry_point": TwoArmsVector}
        gymnasium.register(NAME.format(version), **entry_points, kwargs={"version": version})

__all__ = ["ID", "TwoArms", "TwoArmsVector"]
