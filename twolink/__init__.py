"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

import importlib
from typing import TYPE_CHECKING, Any

from twolink import effects, errors, lagrange
from twolink._version import __version__ as __version__
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.dynamics.compiled import Compiled
from twolink.integrate.steps.methods import methods
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
    from twolink.exchange.equation_check import EquationCheck, check_equations
    from twolink.exchange.export import export
    from twolink.exchange.model_comparison import ModelComparison, compare_models
    from twolink.exchange.urdf_scene import scene_of
    from twolink.hard.referee import judge
    from twolink.hard.step_table import StepTable, step_table
    from twolink.hard.verdict import Verdict
    from twolink.identification.fit_result import SceneFit
    from twolink.identification.identify import identify
    from twolink.identification.result import Identification
    from twolink.identification.scene_fit import fit
    from twolink.io.progress import progress_bar
    from twolink.linting.findings import Findings
    from twolink.linting.lint import lint
    from twolink.optimization.gradient import Gradient, gradient
    from twolink.optimization.optimize import Optimum, optimize
    from twolink.service.client import connect
    from twolink.simulation.energy_balance import EnergyBalance, energy_book, loop_forces
    from twolink.simulation.sensitivities import Sensitivities, sensitivities
    from twolink.simulation.stepwise import Simulation
    from twolink.sweeps.sweeping import sweep

_IMPORTED_WHEN_USED = {
    "control.equilibria": ("Equilibria", "equilibria"),
    "control.feedback": ("lqr",),
    "control.linearization": ("Linearization", "linearize"),
    "control.periodic": ("PeriodicMotion", "periodic_motion"),
    "exchange.equation_check": ("EquationCheck", "check_equations"),
    "exchange.export": ("export",),
    "exchange.model_comparison": ("ModelComparison", "compare_models"),
    "hard.referee": ("judge",),
    "hard.step_table": ("StepTable", "step_table"),
    "hard.verdict": ("Verdict",),
    "exchange.urdf_scene": ("scene_of",),
    "identification.fit_result": ("SceneFit",),
    "identification.identify": ("identify",),
    "identification.result": ("Identification",),
    "identification.scene_fit": ("fit",),
    "io.progress": ("progress_bar",),
    "linting.findings": ("Findings",),
    "linting.lint": ("lint",),
    "optimization.gradient": ("Gradient", "gradient"),
    "optimization.optimize": ("Optimum", "optimize"),
    "service.client": ("connect",),
    "simulation.energy_balance": ("EnergyBalance", "energy_book", "loop_forces"),
    "simulation.sensitivities": ("Sensitivities", "sensitivities"),
    "simulation.stepwise": ("Simulation",),
    "sweeps.sweeping": ("sweep",),
}

# Methods of classes that are functions of rooms above theirs: class, name, module.
_METHODS_OF_ROOMS_ABOVE = (
    (Robot, "export_c", "exchange.c_code"),
    (Robot, "export_urdf", "exchange.urdf_text"),
    (Robot, "export_mjcf", "exchange.mjcf_text"),
    (Scene, "export_fmu", "exchange.fmu"),
)


def _method(name: str, module: str) -> Any:
    def method(self: Any, *args: Any, **options: Any) -> Any:
        return getattr(importlib.import_module(f"twolink.{module}"), name)(self, *args, **options)

    method.__name__, method.__doc__ = name, f"Write a file; see `tl.export` and `twolink.{module}.{name}`."
    return method


for _class, _name, _module in _METHODS_OF_ROOMS_ABOVE:
    setattr(_class, _name, _method(_name, _module))


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    module = next((module for module, names in _IMPORTED_WHEN_USED.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module 'twolink' has no attribute {name!r}")
    return getattr(importlib.import_module(f"twolink.{module}"), name)


def __dir__() -> list[str]:
    """List the public names, for dir() and tab completion."""
    return sorted([*__all__, "__version__"])


__all__ = [
    "Certificate",
    "Compiled",
    "Cost",
    "EnergyBalance",
    "EquationCheck",
    "Equilibria",
    "Event",
    "Explanation",
    "Findings",
    "Gradient",
    "Identification",
    "Linearization",
    "LoadReport",
    "ModelComparison",
    "Optimum",
    "PeriodicMotion",
    "Robot",
    "Scene",
    "SceneFit",
    "Sensitivities",
    "Simulation",
    "StepTable",
    "Study",
    "Trajectory",
    "Verdict",
    "Worlds",
    "Wrench",
    "accuracy_study",
    "check_equations",
    "compare_models",
    "connect",
    "effects",
    "energy_book",
    "equilibria",
    "errors",
    "explain",
    "export",
    "fit",
    "gradient",
    "identify",
    "judge",
    "lagrange",
    "linearize",
    "lint",
    "load_robot",
    "load_scene",
    "loop_forces",
    "lqr",
    "methods",
    "optimize",
    "periodic_motion",
    "progress_bar",
    "robots",
    "scene_of",
    "scenes",
    "sensitivities",
    "simulate",
    "simulate_many",
    "step_table",
    "sweep",
]
