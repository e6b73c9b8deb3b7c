"""The domains as Gymnasium environments; importing this package registers them.

    import gymnasium, harness.gym
    env = gymnasium.make("pomdp_harness/RockSample-7x8-v1")
    envs = gymnasium.make_vec("pomdp_harness/RockSample-7x8-v1", num_envs=1000)

Needs Gymnasium: ``pip install 'pomdp-harness[gym]'``. Any other domain goes into :class:`PomdpEnv` or
:class:`PomdpVectorEnv` as an object.
"""

try:
    import gymnasium  # noqa: F401
except ImportError as error:
    raise ImportError("harness.gym needs Gymnasium: pip install 'pomdp-harness[gym]'") from error

from harness.gym.registration import environment_id, register
from harness.gym.single import PomdpEnv
from harness.gym.vector import PomdpVectorEnv

__all__ = ["PomdpEnv", "PomdpVectorEnv", "environment_id", "register"]

register()
