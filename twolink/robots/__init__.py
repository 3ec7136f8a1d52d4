"""Robots: a URDF becomes a checked Pinocchio model and a load report.

In: a URDF as path or text, or the name of a robot. Out: a `RobotModel` and a `LoadReport` of what is suspicious, read,
ignored, repaired and assumed; what is wrong is refused with file, line and remedy. This room knows nothing of dynamics
queries, scenes or simulation.
"""

from twolink.robots.catalogue import catalogue_names
from twolink.robots.load import load_model, robots
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.model import RobotModel

__all__ = ["Finding", "LoadReport", "RobotModel", "catalogue_names", "load_model", "robots"]
