"""Pairs of joints that are the same in two robots, and the poses of their bodies when both are at zero.

A mechanism is told by the screws of its joints and the inertias of its bodies in the world, both at zero (the product
of exponentials, Brockett 1984). Link frames, fixed joints, the order of joints and the axes in which an inertia is
written leave no trace in them.
"""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from twolink.robots.checks import mass_matrix_by_columns
from twolink.robots.joint_layout import without_joints

STATES = 100


@dataclass(frozen=True)
class ScrewModel:
    """A model at zero: of each joint its screws (6, k), of each body its inertia, of each link its pose, in the world.

    children: of each joint. links: the names of the links that each joint carries. size: the reach at zero [m].
    """

    model: pin.Model
    screws: tuple[np.ndarray, ...]
    inertias: tuple[pin.Inertia, ...]
    frames: dict[str, pin.SE3]
    links: tuple[tuple[str, ...], ...]
    children: tuple[tuple[int, ...], ...]
    size: float


@dataclass
class Match:
    """Joint a of the first mechanism is joint b of the second.

    shift: moves the second's bodies behind the joint, at zero, onto the first's; before: those ahead of it. offset and
    sign: q_a = sign q_b + offset, of joints with one coordinate.
    """

    a: int
    b: int
    before: pin.SE3 = field(default_factory=pin.SE3.Identity)
    shift: pin.SE3 = field(default_factory=pin.SE3.Identity)
    sign: float = 1.0
    offset: float = 0.0

    @property
    def moved(self) -> pin.SE3:
        """The part of the shift that the joint's place adds."""
        return self.shift * self.before.inverse()


def screw_model_of(model: pin.Model) -> ScrewModel:
    """The model at zero."""
    data, zero = model.createData(), pin.neutral(model)
    pin.computeJointJacobians(model, data, zero)
    pin.updateFramePlacements(model, data)
    columns = [slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in range(model.njoints)]
    bodies = [(f.name, f.parentJoint, data.oMf[k]) for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY]
    inertias = tuple(data.oMi[j].act(model.inertias[j]) for j in range(model.njoints))
    points = [data.oMi[j].translation for j in range(model.njoints)] + [body.lever for body in inertias]
    return ScrewModel(
        model,
        tuple(np.reshape(data.J, (6, -1), order="F")[:, part].copy() for part in columns),
        inertias,
        {name: pin.SE3(pose) for name, _, pose in bodies},
        tuple(tuple(name for name, owner, _ in bodies if owner == j) for j in range(model.njoints)),
        tuple(tuple(k for k in range(1, model.njoints) if model.parents[k] == j) for j in range(model.njoints)),
        max(1e-3, *(float(np.linalg.norm(point)) for point in points)),
    )


def matched_joints(a: ScrewModel, b: ScrewModel) -> list[tuple[int, int]]:
    """Pairs of joints: of one name; then, below joints that are a pair, of one kind and nearest place."""
    named = {name: k for k, name in enumerate(b.model.names)}
    pairs = {0: 0} | {j: named[name] for j, name in enumerate(a.model.names) if j and name in named}
    left = [k for k in range(1, b.model.njoints) if k not in pairs.values()]
    for j in range(1, a.model.njoints):
        if j in pairs:
            continue
        above = pairs[_known(a.model, j, pairs)]
        near = [k for k in left if _known(b.model, k, pairs.values()) == above
                and b.screws[k].shape == a.screws[j].shape]  # fmt: skip
        if near:
            pairs[j] = min(near, key=lambda k: (_distance(a.screws[j], b.screws[k]), k))
            left.remove(pairs[j])
    return [(j, pairs[j]) for j in range(1, a.model.njoints) if j in pairs]


def reduced(model: pin.Model, kept: set[int]) -> pin.Model:
    """The model with the other joints fixed at zero."""
    return without_joints(model, [j for j in range(1, model.njoints) if j not in kept], pin.neutral(model))


def aligned(a: ScrewModel, b: ScrewModel, pairs: list[tuple[int, int]], tolerance: float) -> list[Match]:
    """The matches, each with the shift by which most of what is behind the joint agrees."""
    partner, shifts, found = dict(pairs), {0: pin.SE3.Identity()}, []
    for j, k in pairs:
        before = shifts[_known(a.model, j, shifts)]
        match = Match(j, k, before, before)
        tried = [(_mismatch(a, b, partner, j, k, shift, tolerance), n, shift)
                 for n, shift in enumerate(_shifts(a, b, partner, match))]  # fmt: skip
        match.shift = min(tried, key=lambda one: one[:2])[2]
        if a.screws[j].shape == b.screws[k].shape == (6, 1):
            ours, theirs = a.screws[j][:, 0], (match.shift.action @ b.screws[k])[:, 0]
            match.sign = -1.0 if np.linalg.norm(ours + theirs) < np.linalg.norm(ours - theirs) else 1.0
            turn = pin.log6(match.moved).vector
            amount = float(turn @ ours / (ours @ ours))
            if np.linalg.norm(turn - amount * ours) <= tolerance * a.size:
                match.offset = -amount if abs(amount) > tolerance else 0.0
        shifts[j] = match.shift
        found.append(match)
    return found


def dynamics_differences(a: ScrewModel, b: ScrewModel, matches: Sequence[Match]) -> dict[str, float]:
    """The largest differences of M, h and g over random states, of their own size, in the coordinates of a."""
    rng, worst = np.random.default_rng(32), {"M": 0.0, "h": 0.0, "g": 0.0}
    order, signs, zero = np.zeros(a.model.nv, int), np.ones(a.model.nv), np.zeros(b.model.nv)
    for m in matches:
        ours, theirs = (slice(x.idx_vs[j], x.idx_vs[j] + x.nvs[j]) for x, j in ((a.model, m.a), (b.model, m.b)))
        order[ours], signs[ours] = np.arange(b.model.nv)[theirs], m.sign
        zero[theirs] = -m.sign * m.offset
    for _ in range(STATES):
        turned, v = rng.uniform(-2, 2, (2, a.model.nv))
        there, rate = zero.copy(), np.zeros(b.model.nv)
        there[order] += signs * turned
        rate[order] = signs * v
        mass, bias, weight = _equations(b.model, there, rate)
        mapped = (signs[:, None] * mass[np.ix_(order, order)] * signs, signs * bias[order], signs * weight[order])
        for name, x, y in zip(worst, _equations(a.model, turned, v), mapped, strict=True):
            size = max(float(np.abs(x).max(initial=0.0)), 1e-12)
            worst[name] = max(worst[name], float(np.abs(x - y).max(initial=0.0)) / size)
    return worst


def _equations(model: pin.Model, turned: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, h and g of a model that is turned from zero."""
    data, q = model.createData(), pin.integrate(model, pin.neutral(model), turned)
    bias, weight = pin.nonLinearEffects(model, data, q, v), pin.computeGeneralizedGravity(model, data, q)
    return mass_matrix_by_columns(model, data, q), np.array(bias), np.array(weight)


def _known(model: pin.Model, joint: int, known: Container[int]) -> int:
    """The nearest joint above that is known."""
    parent = int(model.parents[joint])
    while parent not in known:
        parent = int(model.parents[parent])
    return parent


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Of two sets of screws; those of one joint may point the other way."""
    if a.shape != b.shape:
        return np.inf
    return float(min(np.abs(a - b).max(), np.abs(a + b).max() if a.shape[1] == 1 else np.inf))


def _shifts(a: ScrewModel, b: ScrewModel, partner: dict[int, int], match: Match) -> Iterator[pin.SE3]:
    """Shifts that may be: none of its own, that of a link's frame, and turns or slides of the joint itself."""
    yield match.before
    j, k = match.a, match.b
    for name in [name for name in a.links[j] if name in b.links[k]][:1]:
        yield a.frames[name] * b.frames[name].inverse()
    if a.screws[j].shape != (6, 1):
        return
    screw = a.screws[j][:, 0]
    centre = _point(screw)
    pairs = [(a.inertias[j].lever - centre, match.before.act(b.inertias[k].lever) - centre)]
    for child in a.children[j]:
        if child in partner and a.screws[child].shape == b.screws[partner[child]].shape == (6, 1):
            theirs = match.before.action @ b.screws[partner[child]][:, 0]
            pairs += [(_point(a.screws[child][:, 0]) - centre, _point(theirs) - centre)]
            pairs += [(a.screws[child][3:, 0], s * theirs[3:]) for s in (1.0, -1.0)]
    for ours, theirs in pairs:
        amount = _turn(screw, ours, theirs)
        yield pin.exp6(pin.Motion(screw * amount)) * match.before


def _point(screw: np.ndarray) -> np.ndarray:
    """The point of a screw's axis that is nearest to the origin."""
    return np.cross(screw[3:], screw[:3])


def _turn(screw: np.ndarray, ours: np.ndarray, theirs: np.ndarray) -> float:
    """By how much a joint turns, or slides, to bring one arrow from its axis nearest to another."""
    axis = screw[3:]
    if not axis.any():
        return float(screw[:3] @ (ours - theirs))
    u, w = (x - axis * (axis @ x) for x in (theirs, ours))
    return float(np.arctan2(axis @ np.cross(u, w), u @ w))


def _mismatch(
    a: ScrewModel, b: ScrewModel, partner: dict[int, int], j: int, k: int, shift: pin.SE3, tolerance: float
) -> tuple[int, int]:
    """Counts of differences under a shift: of the properties of the body and the next joints, and of links' frames."""
    ours, theirs = a.inertias[j], shift.act(b.inertias[k])
    near = tolerance * a.size
    wrong = int(np.abs(ours.lever - theirs.lever).max() > near and ours.mass > 0)
    wrong += np.abs(ours.inertia - theirs.inertia).max() > inertia_tolerance(ours.mass, ours.inertia, a.size, tolerance)
    for child in a.children[j]:
        if child in partner:
            wrong += _distance(a.screws[child], shift.action @ b.screws[partner[child]]) > near
    frames = [(a.frames[name], shift * b.frames[name]) for name in a.links[j] if name in b.links[k]]
    return wrong, sum(not same_pose(x, y, tolerance, a.size) for x, y in frames)


def inertia_tolerance(mass: float, inertia: np.ndarray, size: float, tolerance: float) -> float:
    """The tolerance of the moments of inertia of equal bodies, kg m^2."""
    return float(tolerance * np.abs(inertia).max() + mass * (tolerance * size) ** 2)


def same_pose(a: pin.SE3, b: pin.SE3, tolerance: float, size: float) -> bool:
    """True if two poses are equal, to the tolerance."""
    turned, moved = np.abs(a.rotation - b.rotation).max(), np.abs(a.translation - b.translation).max()
    return bool(turned <= 10 * tolerance and moved <= tolerance * size)
