"""Checks that a robot can exist: inertias of real bodies, and a mass matrix that can be inverted."""

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError
from twolink.io.model_trees import trees_of
from twolink.robots.tree import Tree
from twolink.robots.urdf import UrdfLink

# Relative to the largest principal moment; URDFs carry six or so digits.
_ROUNDING = 1e-6
# Below m * (1 micrometre)^2 a moment of inertia is rounding noise of the file.
_NOISE_LENGTH_SQUARED = 1e-12


def _defects(inertia: np.ndarray, mass: float) -> tuple[float, float]:
    """How far the principal moments I1 <= I2 <= I3 are from those of a real body, (0, 0) within rounding.

    First -I1 [kg m^2] where it is below zero; then (I3 - I1 - I2) / max(I3, -I1) where that is above zero. Every
    distribution of positive mass obeys the triangle inequality: I1 + I2 - I3 = 2 * integral of z^2 dm.
    """
    i1, i2, i3 = np.linalg.eigvalsh(inertia).tolist()
    rounding, excess = _ROUNDING * i3 + _NOISE_LENGTH_SQUARED * mass, i3 - i1 - i2
    return -i1 if -i1 > rounding else 0.0, excess / max(i3, -i1) if excess > rounding else 0.0


def check_bodies(tree: Tree, model: pin.Model, unphysical: str) -> list[str]:
    """Refuse a body whose inertia no real body has. Returns the links whose own inertia no real body has.

    A body is a link with all links fixed to it: only their sum enters the equations of motion. Files often give
    sensors and covers impossible inertias; judged alone they would refuse half of the published robots.
    """
    for joint in range(model.njoints):
        inertia = model.inertias[joint]
        if not np.isfinite(inertia.inertia).all():
            raise RobotError("inertia is not finite: numbers are too large", where=tree.name, remedy="check the units")
        if unphysical == "refuse" and is_impossible(inertia.inertia, inertia.mass):
            raise _impossible(_culprit(tree, model, joint))
    return [link.name for link in tree.links.values() if is_impossible(link.inertia, link.mass)]


def is_impossible(inertia: np.ndarray, mass: float) -> bool:
    """Whether no body has this inertia (3, 3) [kg m^2] about its centre of mass."""
    return any(_defects(inertia, mass))


def _impossible(link: UrdfLink) -> RobotError:
    """The error for the link whose inertia makes a body impossible."""
    moments = ", ".join(f"{m:.6g}" for m in np.linalg.eigvalsh(link.inertia))
    tail = 'correct it, or load it as it is with unphysical="report"'
    if _defects(link.inertia, link.mass)[0]:
        what = f"inertia is not positive semi-definite: principal moments ({moments}) kg m^2"
        remedy = f"give the inertia about the centre of mass of a real body; {tail}"
    else:
        what = f"inertia breaks the triangle inequality: no body has the principal moments ({moments}) kg m^2"
        remedy = f"the two smaller ones must add up to the largest at least; {tail}"
    return RobotError(what, where=link.where, remedy=remedy, code="impossible-inertia")


def _culprit(tree: Tree, model: pin.Model, joint: int) -> UrdfLink:
    """The link to blame for a body: the part that is worst."""
    parts = [f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
    links = [tree.links[name] for name in parts if name in tree.links]
    return max(links, key=lambda k: _defects(k.inertia, k.mass))


def check_invertible(tree: Tree, model: pin.Model) -> None:
    """Refuse a robot with a joint that moves no inertia, whatever the configuration.

    The pivots of L^T D L, taken from the last joint to the first, are what the articulated-body algorithm divides
    by: D_i = S_i^T I^A_i S_i (Featherstone 2008, eq. 7.44). A pivot that is zero next to M_ii in every one of
    several configurations belongs to a massless leaf, or to links without inertia about the joint's axis.
    """
    smallest = np.concatenate([_smallest_pivots(tree.model) for tree in trees_of(model)])
    bad = np.flatnonzero(smallest <= 1e-15 * model.nv)
    if bad.size == 0:
        return
    owners = [j for j in range(1, model.njoints) for i in bad if model.idx_vs[j] <= i < model.idx_vs[j] + model.nvs[j]]
    names = list(dict.fromkeys(model.names[j] for j in owners))
    name = names[-1]
    moved = next((j for j in tree.joints if j.name == name), None)
    link = tree.root if moved is None else moved.child
    massless = model.inertias[owners[-1]].mass == 0
    why = "the link it moves has no mass" if massless else "what it moves has no inertia about its axis"
    what = f"joint {name!r} cannot be accelerated: {why}, so its acceleration is not determined"
    lock = ", ".join(f"{n!r}: 0" for n in names)
    remedy = f"give link {link!r} a mass and an inertia, or hold such joints with lock={{{lock}}}"
    raise RobotError(what, where=tree.links[link].where, remedy=remedy, code="no-inertia")


def _smallest_pivots(model: pin.Model) -> np.ndarray:
    """The relative pivots (nv,), each where it is largest of several configurations."""
    weightless, smallest = model.copy(), np.zeros(model.nv)
    weightless.gravity.linear = np.zeros(3)
    data = model.createData()
    mass_matrix = mass_matrix_by_columns if any("Mimic" in joint.shortname() for joint in model.joints) else pin.crba
    for q in _configurations(model):
        smallest = np.maximum(smallest, _relative_pivots(mass_matrix(weightless, data, q)))
    return smallest


def mass_matrix_by_columns(model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
    """M(q) (nv, nv) by the Newton-Euler algorithm: M e_k = tau(q, 0, e_k) - tau(q, 0, 0) for each unit vector e_k.

    For mimic joints: Pinocchio 4.1's composite-rigid-body algorithm drops the couplings of branches that follow
    different joints of one degree of freedom.
    """
    zero = np.zeros(model.nv)
    weight = pin.rnea(model, data, q, zero, zero)
    matrix = np.stack([pin.rnea(model, data, q, zero, unit) - weight for unit in np.eye(model.nv)])
    return np.asarray((matrix + matrix.T) / 2)


def _configurations(model: pin.Model) -> list[np.ndarray]:
    """The neutral configuration and three fixed, generic ones (tangent steps from it: limits do not matter)."""
    rng = np.random.default_rng(20)
    neutral = pin.neutral(model)
    return [neutral, *(pin.integrate(model, neutral, rng.uniform(-1, 1, model.nv)) for _ in range(3))]


def _relative_pivots(matrix: np.ndarray) -> np.ndarray:
    """D_i / M_ii of M = L^T D L, 0 where there is nothing to divide by."""
    work = matrix.copy()
    diagonal = np.diag(matrix)
    pivots = np.zeros(len(work))
    for i in range(len(work) - 1, -1, -1):
        if not (diagonal[i] > 0 and work[i, i] > 1e-300):
            continue
        pivots[i] = work[i, i] / diagonal[i]
        row = work[i, :i].copy()
        work[:i, :i] -= np.outer(row, row) / work[i, i]
    return pivots
