"""Environments of Gymnasium from scenes: torques are given, states are seen. Needs `twolink[gym]`.

In: a scene, a reward, what is seen and given. Out: `Environment`, one world, and `VectorEnvironment`, many in a
batch of compiled steps. This room knows no learning.
"""
