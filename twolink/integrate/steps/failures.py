"""Failures that every solver reports alike, and which joints make accelerations large or not finite at a state."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Numbers
from twolink.errors import AccuracyError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import loaded
from twolink.integrate.motion.state import Array

MAX_STEPS = 10_000_000
HOPELESS = 100  # how many times too slow the pace must be
SHORTER = "ask for a shorter duration or less accuracy"
TEXTS = {  # by code: what, remedy
    "steps-collapsed": ("the step size has collapsed: the equations are stiff, singular or not finite there",
                        f'try method="esdirk43" or "scipy-radau" for stiff scenes, or {SHORTER}'),
    "loops-singular": ("the step size has collapsed: the loops are singular there, and steps of this tolerance do not "
                       "get across", "ask for less accuracy, or a duration that ends before"),
    "not-finite": ("the state is not finite any more", "check forces and the initial state"),
    "step-too-large": ("the state is not finite any more", "take steps smaller than {step:.3g} s"),
    "acceleration-not-finite": ("the acceleration is not finite", "check forces, masses and the initial state"),
    "too-many-steps": ("more than {limit:,} steps are needed to the end", SHORTER),
}  # fmt: skip


def failure(code: str, t: float, cause: str = "", **data: float) -> AccuracyError:
    """The error of a code at a time t [s], and what causes it; its data has t and the numbers of the message."""
    what, remedy = (text.format(**data) for text in TEXTS[code])
    what = f"{what}: {cause}" if cause else what
    return AccuracyError(what, where=f"t = {t:.6g} s", remedy=remedy, code=code, t=t, **data)


def is_hopeless(steps: Any, limit: float, t: Any, start: Any, end: Any) -> Any:
    """True if the pace so far leads beyond HOPELESS times the limit of steps; of numbers or of one a world (n,)."""
    return steps * (end - start) > HOPELESS * limit * (t - start)


SINGULAR = 1e-6  # eigenvalues of the mass matrix with a unit diagonal: below, joints move next to no mass
SHARE = 0.3  # of the largest entry of an eigenvector, that a joint must have to be named
MOST_NAMES = 4


@np.errstate(all="ignore")
def cause(equations: Equations, t: float, x: Array) -> str:
    """The cause of large or not finite accelerations at a state x (size,); "" where nothing stands out."""
    robot, space = equations.robot, equations.space
    names = [joint.name for joint in robot.joints for _ in range(joint.v.start, joint.v.stop)]
    lost = ~np.isfinite(x[space.v_rows])
    if not np.isfinite(x).all():
        return f"the velocity of {_named(names, lost)} is not finite" if lost.any() else ""
    light = _without_mass(pin.crba(robot.model, robot.model.createData(), x[: space.nq]))
    if light.any():
        return (f"there {_named(names, light)} can move without moving a mass, as the mass matrix is singular; give "
                "the links between such joints inertias, or the joints armatures")  # fmt: skip
    _, loads = loaded(equations, equations.mechanism, t, x, Numbers)
    wild = ~np.isfinite([float(np.squeeze(torque)) for torque in loads.tau])
    for i, wrench in loads.wrenches.items():
        if not np.isfinite([float(np.squeeze(entry)) for entry in wrench]).all():
            wild |= np.array(names) == robot.model.names[i]
    return f"the load of effects on {_named(names, wild)} is not finite" if wild.any() else ""


def _without_mass(mass: Array) -> Array:
    """Degrees of freedom (nv,) that move no mass, alone or together, by the upper half of the mass matrix."""
    diagonal = np.diag(mass)
    if not (diagonal > 0.0).all():
        return np.asarray(~(diagonal > 0.0))
    root = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(mass / np.outer(root, root), UPLO="U")
    first = np.abs(vectors[:, 0])
    return np.asarray((first > SHARE * first.max()) & (values[0] < SINGULAR))


def _named(names: Iterable[str], chosen: Array) -> str:
    """Joints by name, a few of them."""
    found = list(dict.fromkeys(name for name, which in zip(names, chosen, strict=True) if which))
    more = f" and {len(found) - MOST_NAMES} more" if len(found) > MOST_NAMES else ""
    return f"joint{'s' * (len(found) > 1)} {', '.join(map(repr, found[:MOST_NAMES]))}{more}"
