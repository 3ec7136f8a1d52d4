"""Which parameters are looked for: names and patterns, and how each changes pi of tau = Y pi."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.regressors import BODY_PARAMETERS
from twolink.errors import QueryError, nearest


@dataclass(frozen=True)
class Selection:
    """pi = pi0 + C (theta - theta0): names (k,) of theta, the robot's own values theta0 (k,), and C (p, k)."""

    names: tuple[str, ...]
    nominal: np.ndarray
    columns: np.ndarray

    def parameters(self, robot: Robot, theta: np.ndarray) -> np.ndarray:
        """pi (p,) for theta (k,)."""
        return np.asarray(robot.parameter_values + self.columns @ (theta - self.nominal))


def select(robot: Robot, parameters: Sequence[str] | None) -> Selection:
    """The parameters that names and patterns ("forearm.*") stand for; None: all that belong to bodies.

    A mass that is looked for without the other nine parameters of its link keeps the link's centre of mass and its
    inertia about that, as in `robot.compiled(parameters=...)`: dpi/dm = (1, c, -[c x]^2). All other parameters are
    entries of pi, and what was not asked for keeps its entry.

    Raises
    ------
    QueryError
        For a name or pattern that fits nothing, with the nearest right name; code "unknown-parameter".
    """
    known = robot.parameter_names
    names = known[: 10 * (robot.model.njoints - 1)] if parameters is None else _expand(parameters, known)
    columns = np.zeros((len(known), len(names)))
    chosen = set(names)
    for k, name in enumerate(names):
        row = known.index(name)
        columns[row, k] = 1.0
        link = name.removesuffix(".mass")
        if link != name and chosen.isdisjoint(f"{link}.{entry}" for entry in BODY_PARAMETERS[1:]):
            lever = robot.model.inertias[row // 10 + 1].lever
            columns[row : row + 10, k] = pin.Inertia(1.0, lever, np.zeros((3, 3))).toDynamicParameters()
    return Selection(names, robot.parameter_values[[known.index(name) for name in names]], columns)


def _expand(parameters: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The known names that the texts stand for, each once, in the order in which they are asked for."""
    if isinstance(parameters, str) or not isinstance(parameters, Sequence) or not parameters:
        what, remedy = f"expected a list of names, got {parameters!r}", 'such as ["forearm.mass", "*.damping"]'
        raise QueryError(what, argument="parameters", remedy=remedy)
    found: list[str] = []
    for text in parameters:
        fitting = [name for name in known if name == text or fnmatchcase(name, str(text))]
        if not fitting:
            what, remedy = f"there is no parameter {text!r}", _remedy(str(text), known)
            raise QueryError(what, argument="parameters", remedy=remedy, code="unknown-parameter")
        found += fitting
    return tuple(dict.fromkeys(found))


def _remedy(text: str, known: Sequence[str]) -> str:
    link = text.rpartition(".com.")[0]
    if f"{link}.mass" in known:
        return f"look for {link}.mass and {link}.first_moment.*: the centre of mass is their ratio"
    link = text.rpartition(".inertia.")[0]
    if f"{link}.mass" in known:
        return f"look for {link}.origin_inertia.*, the inertia about the joint's origin"
    return nearest(text, known)
