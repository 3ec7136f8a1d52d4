"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

from twolink import effects, errors, lagrange
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.scenes import Scene, load_scene
from twolink.simulate import simulate
from twolink.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "Robot",
    "Scene",
    "Trajectory",
    "Wrench",
    "effects",
    "errors",
    "lagrange",
    "load_robot",
    "load_scene",
    "simulate",
]
