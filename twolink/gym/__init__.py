"""Environments of Gymnasium from scenes: an agent gives torques, and sees states. Needs `twolink[gym]`.

In: a scene, a reward, what an agent sees and does. Out: `Environment`, one world, and `VectorEnvironment`, many in a
batch of compiled steps. This room knows no learning.
"""

from twolink.gym.environments import Environment, VectorEnvironment

__all__ = ["Environment", "VectorEnvironment"]
