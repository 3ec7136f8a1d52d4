"""twolink: ask a URDF a dynamics question and get an answer you can trust, with its price."""

from typing import TYPE_CHECKING, Any

from twolink import effects, errors, lagrange
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, Wrench, load_robot
from twolink.ensembles import Worlds, simulate_many
from twolink.explain import explain
from twolink.scenes import Scene, load_scene
from twolink.simulate import simulate
from twolink.trajectory import Trajectory

if TYPE_CHECKING:
    from twolink.book import Book, energy_book, loop_forces
    from twolink.client import connect

__version__ = "0.1.0"

_LATER = {"Book": "book", "energy_book": "book", "loop_forces": "book", "connect": "client"}  # imported when used


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'twolink' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"twolink.{_LATER[name]}"), name)


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
