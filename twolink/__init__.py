"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

from typing import TYPE_CHECKING, Any

from twolink import effects, errors, lagrange
from twolink._version import __version__ as __version__
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.scenes import Scene, load_scene
from twolink.simulation import Worlds, simulate_many
from twolink.simulation.explanation import explain
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from twolink.service.client import connect
    from twolink.simulation.energy_balance import Book, energy_book, loop_forces

# Imported when used.
_BOOK = "twolink.simulation.energy_balance"
_LATER = {
    "Book": _BOOK,
    "energy_book": _BOOK,
    "loop_forces": _BOOK,
    "connect": "twolink.service.client",
}  # imported when used


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'twolink' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_LATER[name]), name)


__all__ = [
    "Book",
    "Robot",
    "Scene",
    "Study",
    "Trajectory",
    "Worlds",
    "Wrench",
    "accuracy_study",
    "connect",
    "effects",
    "energy_book",
    "errors",
    "explain",
    "lagrange",
    "load_robot",
    "load_scene",
    "loop_forces",
    "simulate",
    "simulate_many",
]
