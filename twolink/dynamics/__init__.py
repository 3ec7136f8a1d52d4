"""Dynamics queries: `Robot` answers forward and inverse dynamics, kinematics, energies and their derivatives.

In: a checked model, states on leading batch axes. Out: arrays, by Pinocchio or by functions that are compiled from
the formulas of `twolink.algorithms` and certified against Pinocchio. This room knows nothing of effects, scenes or
time.
"""

from twolink.dynamics.arguments import Wrench
from twolink.dynamics.loading import load_robot
from twolink.dynamics.robot import Robot

__all__ = ["Robot", "Wrench", "load_robot"]
