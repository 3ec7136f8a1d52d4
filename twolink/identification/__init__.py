"""Parameters of a robot from measured motions: which can be told, their values with intervals, and a URDF with them.

In: a robot, measured q, v, a and joint torques. Out: base parameters in words, an `Identification`, trajectories that
excite all parameters. This room knows no scene, no simulation and no command line.
"""

from twolink.identification.base_parameters import BaseParameters, base_parameters
from twolink.identification.excitation import ExcitingMotion, exciting_motion
from twolink.identification.found_urdf import write_urdf
from twolink.identification.identify import identify
from twolink.identification.result import Identification

__all__ = [
    "BaseParameters",
    "ExcitingMotion",
    "Identification",
    "base_parameters",
    "exciting_motion",
    "identify",
    "write_urdf",
]
