"""Robots: reading a URDF, refusing what is wrong, reporting what is ignored, repaired and assumed."""

from twolink.robots.catalogue import catalogue_names
from twolink.robots.load import load_model
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.model import RobotModel

__all__ = ["Finding", "LoadReport", "RobotModel", "catalogue_names", "load_model"]
