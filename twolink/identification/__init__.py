"""Parameters of a robot from measured motions: which can be told, their values with intervals, and a URDF with them.

In: a robot, measured q, v, a and joint torques; or a scene and measured positions. Out: base parameters in words, an
`Identification` or a `SceneFit`, trajectories that excite all parameters. This room knows no command line and no
service.
"""

from twolink.identification.base_parameters import BaseParameters, base_parameters
from twolink.identification.excitation import ExcitingMotion, exciting_motion
from twolink.identification.fit_result import SceneFit
from twolink.identification.found_urdf import write_urdf
from twolink.identification.identify import identify
from twolink.identification.log_files import Log, read_log
from twolink.identification.result import Identification
from twolink.identification.scene_fit import fit

__all__ = [
    "BaseParameters",
    "ExcitingMotion",
    "Identification",
    "Log",
    "SceneFit",
    "base_parameters",
    "exciting_motion",
    "fit",
    "identify",
    "read_log",
    "write_urdf",
]
