"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

from twolink import effects, errors, lagrange
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.ensembles import Worlds, simulate_many
from twolink.explain import explain
from twolink.scenes import Scene, load_scene
from twolink.simulate import simulate
from twolink.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "Robot",
    "Scene",
    "Study",
    "Trajectory",
    "Worlds",
    "Wrench",
    "accuracy_study",
    "effects",
    "errors",
    "explain",
    "lagrange",
    "load_robot",
    "load_scene",
    "simulate",
    "simulate_many",
]
