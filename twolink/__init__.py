"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

import importlib
from typing import TYPE_CHECKING, Any

from twolink import effects, errors, lagrange
from twolink._version import __version__ as __version__
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.dynamics.compiled import Compiled
from twolink.integrate.methods import methods
from twolink.robots import LoadReport, robots
from twolink.scenes import Scene, load_scene, scenes
from twolink.simulation import (
    Certificate,
    Cost,
    Event,
    Explanation,
    Trajectory,
    Worlds,
    explain,
    simulate,
    simulate_many,
)

if TYPE_CHECKING:
    from twolink.control.equilibria import Equilibria, equilibria
    from twolink.control.feedback import lqr
    from twolink.control.linearization import Linearization, linearize
    from twolink.control.periodic import PeriodicMotion, periodic_motion
    from twolink.identification.fit_result import SceneFit
    from twolink.identification.identify import identify
    from twolink.identification.result import Identification
    from twolink.identification.scene_fit import fit
    from twolink.optimization.gradient import Gradient, gradient
    from twolink.optimization.optimize import Optimum, optimize
    from twolink.service.client import connect
    from twolink.show.progress import progress_bar
    from twolink.simulation.energy_balance import EnergyBalance, energy_book, loop_forces
    from twolink.simulation.sensitivities import Sensitivities, sensitivities
    from twolink.sweeps.sweeping import sweep

_IMPORTED_WHEN_USED = {
    "Equilibria": "twolink.control.equilibria",
    "equilibria": "twolink.control.equilibria",
    "Linearization": "twolink.control.linearization",
    "linearize": "twolink.control.linearization",
    "lqr": "twolink.control.feedback",
    "PeriodicMotion": "twolink.control.periodic",
    "periodic_motion": "twolink.control.periodic",
    "fit": "twolink.identification.scene_fit",
    "SceneFit": "twolink.identification.fit_result",
    "Identification": "twolink.identification.result",
    "identify": "twolink.identification.identify",
    "Gradient": "twolink.optimization.gradient",
    "gradient": "twolink.optimization.gradient",
    "Optimum": "twolink.optimization.optimize",
    "optimize": "twolink.optimization.optimize",
    "EnergyBalance": "twolink.simulation.energy_balance",
    "energy_book": "twolink.simulation.energy_balance",
    "loop_forces": "twolink.simulation.energy_balance",
    "connect": "twolink.service.client",
    "progress_bar": "twolink.show.progress",
    "Sensitivities": "twolink.simulation.sensitivities",
    "sensitivities": "twolink.simulation.sensitivities",
    "sweep": "twolink.sweeps.sweeping",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _IMPORTED_WHEN_USED:
        raise AttributeError(f"module 'twolink' has no attribute {name!r}")
    return getattr(importlib.import_module(_IMPORTED_WHEN_USED[name]), name)


def __dir__() -> list[str]:
    """List the public names, for dir() and tab completion."""
    return sorted([*__all__, "__version__"])


__all__ = [
    "Certificate",
    "Compiled",
    "Cost",
    "EnergyBalance",
    "Equilibria",
    "Event",
    "Explanation",
    "Gradient",
    "Identification",
    "Linearization",
    "LoadReport",
    "Optimum",
    "PeriodicMotion",
    "Robot",
    "Scene",
    "SceneFit",
    "Sensitivities",
    "Study",
    "Trajectory",
    "Worlds",
    "Wrench",
    "accuracy_study",
    "connect",
    "effects",
    "energy_book",
    "equilibria",
    "errors",
    "explain",
    "fit",
    "gradient",
    "identify",
    "lagrange",
    "linearize",
    "load_robot",
    "load_scene",
    "loop_forces",
    "lqr",
    "methods",
    "optimize",
    "periodic_motion",
    "progress_bar",
    "robots",
    "scenes",
    "sensitivities",
    "simulate",
    "simulate_many",
    "sweep",
]
