"""`flexlab/TwoArms-v0` for Gymnasium (extra `gym`): two arms carry a flexible beam along its path, and you are the control law.

    import flexlab.gym_environment                                    # makes the environment known
    env = gymnasium.make("flexlab/TwoArms-v0", stiffness=(20, 400))
    envs = gymnasium.make_vec("flexlab/TwoArms-v0", num_envs=64)      # all worlds in one call of machine code

`environment.py` says what is observed, what is done and what is rewarded; `worlds.py` moves the worlds.
"""

try:
    import gymnasium
except ImportError:
    raise ImportError("Gymnasium is not installed: pip install 'flexlab[gym]' brings it.") from None

from flexlab.gym_environment.environment import TwoArms, TwoArmsVector

ID = "flexlab/TwoArms-v0"

if ID not in gymnasium.registry:
    gymnasium.register(ID, entry_point=TwoArms, vector_entry_point=TwoArmsVector)

__all__ = ["ID", "TwoArms", "TwoArmsVector"]
