"""Environments of Gymnasium; the part is `twolink.parts.gym`."""

from twolink.parts.gym.environments import Environment, VectorEnvironment

__all__ = ["Environment", "VectorEnvironment"]
