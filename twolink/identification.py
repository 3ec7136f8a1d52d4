"""Public names of the identification of parameters; the part is `twolink.parts.identification`."""

from twolink.parts.identification.base_parameters import BaseParameters, base_parameters
from twolink.parts.identification.excitation import ExcitingMotion, exciting_motion
from twolink.parts.identification.fit_result import SceneFit
from twolink.parts.identification.found_urdf import write_urdf
from twolink.parts.identification.identify import identify
from twolink.parts.identification.log_files import Log, read_log
from twolink.parts.identification.result import Identification
from twolink.parts.identification.scene_fit import fit

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
