"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

import importlib
from typing import TYPE_CHECKING, Any

from twolink import effects, errors, lagrange
from twolink._version import __version__ as __version__
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.dynamics.compiled import Compiled
from twolink.errors import TwolinkError
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
    from twolink.dynamics.trapezoid import trapezoidal_motion
    from twolink.io.progress import progress_bar
    from twolink.lagrange.equation_check import EquationCheck, check_equations
    from twolink.parts.design.equilibria import Equilibria, equilibria
    from twolink.parts.design.feedback import lqr
    from twolink.parts.design.gradient import Gradient, gradient
    from twolink.parts.design.linearization import Linearization, linearize
    from twolink.parts.design.optimize import Optimum, optimize
    from twolink.parts.design.periodic import PeriodicMotion, periodic_motion
    from twolink.parts.exchange.export import export
    from twolink.parts.exchange.model_comparison import ModelComparison, compare_models
    from twolink.parts.identification.fit_result import SceneFit
    from twolink.parts.identification.identify import identify
    from twolink.parts.identification.result import Identification
    from twolink.parts.identification.scene_fit import fit
    from twolink.parts.lint.findings import Findings
    from twolink.parts.lint.lint import lint
    from twolink.parts.referee.referee import judge, judge_many
    from twolink.parts.referee.step_table import StepTable, step_table
    from twolink.parts.referee.verdict import Verdict, Verdicts
    from twolink.parts.service.client import connect
    from twolink.parts.sweeps.sweeping import sweep
    from twolink.scenes.urdf_scene import scene_of
    from twolink.simulation.energy_balance import EnergyBalance, energy_book, loop_forces
    from twolink.simulation.sensitivities import Sensitivities, sensitivities
    from twolink.simulation.stepwise import Simulation

_IMPORTED_WHEN_USED = {
    "parts.design.equilibria": ("Equilibria", "equilibria"),
    "parts.design.feedback": ("lqr",),
    "parts.design.linearization": ("Linearization", "linearize"),
    "parts.design.periodic": ("PeriodicMotion", "periodic_motion"),
    "lagrange.equation_check": ("EquationCheck", "check_equations"),
    "parts.exchange.export": ("export",),
    "parts.exchange.model_comparison": ("ModelComparison", "compare_models"),
    "parts.lint.findings": ("Findings",),
    "parts.lint.lint": ("lint",),
    "parts.referee.referee": ("judge", "judge_many"),
    "parts.referee.step_table": ("StepTable", "step_table"),
    "parts.referee.verdict": ("Verdict", "Verdicts"),
    "scenes.urdf_scene": ("scene_of",),
    "parts.identification.fit_result": ("SceneFit",),
    "parts.identification.identify": ("identify",),
    "parts.identification.result": ("Identification",),
    "parts.identification.scene_fit": ("fit",),
    "io.progress": ("progress_bar",),
    "parts.design.gradient": ("Gradient", "gradient"),
    "parts.design.optimize": ("Optimum", "optimize"),
    "parts.service.client": ("connect",),
    "simulation.energy_balance": ("EnergyBalance", "energy_book", "loop_forces"),
    "simulation.sensitivities": ("Sensitivities", "sensitivities"),
    "simulation.stepwise": ("Simulation",),
    "dynamics.trapezoid": ("trapezoidal_motion",),
    "parts.sweeps.sweeping": ("sweep",),
}

# Methods of classes that are functions of rooms above theirs: class, name, module.
_METHODS_OF_ROOMS_ABOVE = (
    (Robot, "export_c", "parts.exchange.c_code"),
    (Robot, "export_urdf", "parts.exchange.urdf_text"),
    (Robot, "export_mjcf", "parts.exchange.mjcf_text"),
    (Scene, "export_fmu", "parts.exchange.fmu"),
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
    "TwolinkError",
    "Verdict",
    "Verdicts",
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
    "judge_many",
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
    "trapezoidal_motion",
]
