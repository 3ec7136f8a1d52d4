"""Dynamics queries: forward and inverse dynamics, mass matrix, bias, energy, by Pinocchio."""

from twolink.dynamics.robot import Robot, load_robot
from twolink.dynamics.wrench import Wrench

__all__ = ["Robot", "Wrench", "load_robot"]
