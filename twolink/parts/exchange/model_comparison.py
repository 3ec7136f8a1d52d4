"""compare_models: are two robots the same mechanism, and where not, which number differs and why."""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.arguments import Positive, positive
from twolink.errors import QueryError
from twolink.parts.exchange.inertia_causes import LinkInertia, centre_cause, inertia_cause, link_inertia, mirror_faults
from twolink.parts.exchange.law_comparison import law_differences
from twolink.parts.exchange.matching import (
    STATES,
    Match,
    aligned,
    dynamics_differences,
    inertia_tolerance,
    matched_joints,
    reduced,
    same_pose,
    screw_model_of,
)
from twolink.robots.joint_layout import NO_LIMIT, urdf_kind
from twolink.robots.tree import Tree
from twolink.robots.urdf import Mimic
from twolink.scenes.urdf_scene import followers, urdf_tree
from twolink.simulation.text import BaseResult

_ATTRIBUTES = {"lower limit": "<limit lower>", "upper limit": "<limit upper>", "velocity limit": "<limit velocity>",
               "effort limit": "<limit effort>", "damping": "<dynamics damping>", "friction": "<dynamics friction>",
               "armature": "armature"}  # fmt: skip


@dataclass(frozen=True)
class Difference:
    """One difference of two robots: what differs, where (file, link or joint, attribute), the values, and the cause."""

    what: str
    where: str
    a: Any
    b: Any
    cause: str

    def __str__(self) -> str:
        values = f" ({_shown(self.a)}; {_shown(self.b)})" if self.a is not None or self.b is not None else ""
        return f"{self.where}: {self.what}: {self.cause}{values}"


@dataclass(frozen=True, repr=False)
class ModelComparison(BaseResult):
    """The comparison of two robots: the same mechanism or not.

    Attributes
    ----------
    a, b : str
        Their files.
    joints : tuple of (str, str, float, float)
        Joints of a and of b that are one, with sign and offset [rad, m]: q_a = sign q_b + offset.
    differences : tuple of Difference
        What differs, with its place and cause.
    remarks : tuple of str
        What is no difference, but worth knowing: other names, limbs that one sign keeps from being mirror images.
    dynamics : mapping of str to float
        The largest difference of M, h and g over 100 states, of their own size, in the coordinates of a.
    """

    a: str
    b: str
    joints: tuple[tuple[str, str, float, float], ...]
    differences: tuple[Difference, ...]
    remarks: tuple[str, ...]
    dynamics: Mapping[str, float]

    @property
    def equal(self) -> bool:
        """True if nothing differs."""
        return not self.differences

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data, and equal."""
        return {"equal": self.equal, **super().to_dict()}

    def __str__(self) -> str:
        count = len(self.differences)
        verdict = "equal" if self.equal else f"{count} difference{'s' if count > 1 else ''}"
        sizes = ", ".join(f"{name} to {value:.1e}" for name, value in self.dynamics.items())
        states = f"; over {STATES} states {sizes}" if sizes else ""
        lines = [f"{self.a} and {self.b}: {verdict}, {len(self.joints)} joints matched{states}"]
        lines += [f"  {difference}" for difference in self.differences]
        return "\n".join([*lines, *(f"  remark: {remark}" for remark in self.remarks)])

    __repr__ = __str__


def compare_models(
    a: Robot | str | os.PathLike[str], b: Robot | str | os.PathLike[str], *, tolerance: Positive = 1e-6
) -> ModelComparison:
    """Compare two robots: joints, bodies, limits, damping, friction, and their equations of motion at 100 states.

    Names of links, the order of joints, fixed joints, and the frames in which an inertia is written do not count.

    Parameters
    ----------
    a, b : Robot, str or path
        Robots, or what `load_robot` takes; loaded so, inertias that no body has are taken as they are.
    tolerance : float
        Of masses, moments, limits and the like, relative; of lengths, of the robot's reach.

    Returns
    -------
    ModelComparison
        `equal`, and each difference with its place and its cause.

    Raises
    ------
    QueryError
        A robot was loaded with mimic=True (code "mimic-joints"), or the tolerance is not between 0 and 1.
    """
    first, second = (x if isinstance(x, Robot) else load_robot(x, unphysical="report") for x in (a, b))
    for name, robot in (("a", first), ("b", second)):
        if robot.has_mimic:
            raise QueryError("it has coupled joints", argument=name, remedy="load it with mimic=False, <mimic> is "
                             "compared too", code="mimic-joints")  # fmt: skip
    if positive(tolerance, "tolerance", QueryError, "such as 1e-6") >= 1.0:
        raise QueryError(f"expected less than 1, got {tolerance:g}", argument="tolerance", remedy="such as 1e-6")
    return _Comparison(first, second, tolerance).result()


class _Comparison:
    """Two robots under comparison: without the joints that only one of them has."""

    def __init__(self, a: Robot, b: Robot, tolerance: float) -> None:
        self.robots, self.tolerance = (a, b), tolerance
        self.trees: tuple[Tree, Tree] = (urdf_tree(a), urdf_tree(b))
        self.labels = (a.report.source, b.report.source)
        if self.labels[0] == self.labels[1]:
            self.labels = (f"{self.labels[0]} (a)", f"{self.labels[1]} (b)")
        pairs = matched_joints(screw_model_of(a.model), screw_model_of(b.model))
        common = {j for j, _ in pairs}, {k for _, k in pairs}
        self.missing = [[robot.model.names[j] for j in range(1, robot.model.njoints) if j not in kept]
                        for robot, kept in zip(self.robots, common, strict=True)]  # fmt: skip
        partner = {a.model.names[j]: b.model.names[k] for j, k in pairs}
        self.a, self.b = (screw_model_of(reduced(robot.model, kept))
                          for robot, kept in zip(self.robots, common, strict=True))  # fmt: skip
        index = {name: k for k, name in enumerate(self.b.model.names)}
        ordered = [(j, index[partner[name]]) for j, name in enumerate(self.a.model.names) if j]
        self.matches = aligned(self.a, self.b, ordered, tolerance)

    def result(self) -> ModelComparison:
        """The comparison."""
        names = [(self.a.model.names[m.a], self.b.model.names[m.b], m.sign, m.offset) for m in self.matches]
        found = [*self._structure()]
        for match in self.matches:
            found += [*self._place(match), *self._body(match), *self._numbers(match)]
        found += self._gravity()
        found += [Difference(what, f"{self.labels[1]}, {where}", x, y, cause)
                  for what, where, x, y, cause in law_differences(*self.robots, self.tolerance)]  # fmt: skip
        alike = all(urdf_kind(self.a.model, m.a) == urdf_kind(self.b.model, m.b) for m in self.matches)
        dynamics = dynamics_differences(self.a, self.b, self.matches) if alike else {}
        if not found and max(dynamics.values(), default=0.0) > 10 * self.tolerance:
            found.append(Difference("equations of motion", self.labels[1], None, None, "M, h or g differ"))
        renamed = [f"{x} is called {y} in b" for x, y, *_ in names if x != y]
        mirrored = [f"{label}: {fault}" for label, tree, robot in zip(self.labels, self.trees, self.robots, strict=True)
                    for fault in mirror_faults(tree, robot.model, self.tolerance)]  # fmt: skip
        return ModelComparison(*self.labels, tuple(names), tuple(found), (*renamed, *mirrored), dynamics)

    def _structure(self) -> Iterator[Difference]:
        """Joints that only one of them has, and joints that hang elsewhere or are of another kind."""
        for side, (names, other) in enumerate(zip(self.missing, self.trees[::-1], strict=True)):
            fixed = {joint.name for joint in other.joints if joint.type == "fixed"}
            for name in names:
                cause = f"it is fixed in {'ba'[side]}" if name in fixed else f"{'ba'[side]} has no such joint"
                yield Difference("joint", f"{self.labels[1 - side]}, joint {name!r}", None, None, cause)
        partner = {m.a: m.b for m in self.matches} | {0: 0}
        for m in self.matches:
            above, there = self.a.model.parents[m.a], self.b.model.parents[m.b]
            if partner[above] != there:
                yield Difference("parent", self._joint(m, "<parent>"), self.a.model.names[above],
                                 self.b.model.names[there], "it hangs on another body")  # fmt: skip
            ours, theirs = urdf_kind(self.a.model, m.a), urdf_kind(self.b.model, m.b)
            if ours != theirs:
                yield Difference("type", self._joint(m, "type"), ours, theirs, "another kind of joint")
        followed = [{name: law for name, law in followers(robot, tree).items() if law.joint in robot.model.names}
                    for tree, robot in zip(self.trees, self.robots, strict=True)]  # fmt: skip
        matched = {self.a.model.names[m.a]: m for m in self.matches}
        for m in self.matches:
            x, y = followed[0].get(self.a.model.names[m.a]), followed[1].get(self.b.model.names[m.b])
            if (x is None) != (y is None) or (x and y and not self._same_mimic(m, matched.get(x.joint), x, y)):
                cause = "left out in b" if y is None else "not in a" if x is None else "another relation"
                yield Difference("mimic", self._joint(m, "<mimic>"), x, y, cause)

    def _same_mimic(self, m: Match, leader: Match | None, x: Mimic, y: Mimic) -> bool:
        """True if a joint follows the same one by the same relation: as written, or in the coordinates of a."""
        if leader is None or self.b.model.names[leader.b] != y.joint:
            return False
        ratio = m.sign * leader.sign * y.multiplier
        mapped = ratio, m.sign * y.offset + m.offset - ratio * leader.offset
        near = self.tolerance
        return any(np.allclose(x[1:], other, rtol=near, atol=near) for other in (y[1:], mapped))

    def _place(self, m: Match) -> Iterator[Difference]:
        """The joint's axis and place, its zero, and the frames of its links."""
        near, moved = self.tolerance * self.a.size, m.moved
        if not same_pose(moved, pin.SE3.Identity(), self.tolerance, self.a.size):
            if m.offset:
                cause = f"the joint's zero is displaced: q_a = {'-' if m.sign < 0 else ''}q_b + {m.offset:.6g}"
                yield Difference("zero", self._joint(m, "<origin>"), 0.0, m.offset, cause)
            else:
                turned = float(np.linalg.norm(pin.log3(moved.rotation)))
                places = self.a.model.jointPlacements[m.a], self.b.model.jointPlacements[m.b]
                yield Difference("origin", self._joint(m, "<origin>"), places[0].translation, places[1].translation,
                                 f"turned by {turned:.4g} rad" if turned > self.tolerance else "displaced")  # fmt: skip
        ours, theirs = self.a.screws[m.a], m.shift.action @ self.b.screws[m.b]
        if ours.shape == theirs.shape == (6, 1):
            if m.sign < 0:
                yield Difference("axis", self._joint(m, "<axis>"), 1.0, -1.0, "it points the other way: q_a = -q_b")
            ours, theirs = ours[:, 0], m.sign * theirs[:, 0]
            u, w = (x[3:] if ours[3:].any() else x[:3] for x in (ours, theirs))
            angle = math.atan2(float(np.linalg.norm(np.cross(u, w))), float(u @ w))
            if angle > 10 * self.tolerance:
                yield Difference("axis", self._joint(m, "<axis>"), None, None, f"turned by {angle:.4g} rad")
            elif np.abs(ours - theirs).max() > near:
                yield Difference("origin", self._joint(m, "<origin xyz>"), None, None, "its axis is displaced")
        for name in self.a.links[m.a]:
            if name in self.b.links[m.b] and not m.offset:
                x, y = self.a.frames[name], m.shift * self.b.frames[name]
                if not same_pose(x, y, self.tolerance, self.a.size):
                    yield Difference("frame", f"{self.labels[1]}, link {name!r}", x.translation, y.translation,
                                     "its frame is elsewhere on the body")  # fmt: skip

    def _body(self, m: Match) -> Iterator[Difference]:
        """Mass, centre of mass and inertia: by link where both say it by link, else of the body."""
        ours, theirs = self.a.inertias[m.a], m.shift.act(self.b.inertias[m.b])
        if not any(self._unequal(_in_world(ours), _in_world(theirs))):
            return
        links = [name for name in self.a.links[m.a] if name in self.b.links[m.b]]
        first, second = (tree.links for tree in self.trees)
        single = [(name, link_inertia(first[name]), link_inertia(second[name])) for name in links
                  if name in first and name in second]  # fmt: skip
        changed = [(name, x, y) for name, x, y in single if any(self._unequal(x, y))]
        if not changed:
            turn = self.a.frames[links[0]] if links else pin.SE3.Identity()
            name = self.a.links[m.a][0] if self.a.links[m.a] else self.a.model.names[m.a]
            changed = [(name, _in_world(turn.actInv(ours)), _in_world(turn.actInv(theirs)))]
        for name, x, y in changed:
            where = f"{self.labels[1]}, link {name!r}"
            mass, centre, inertia = self._unequal(x, y)
            if mass:
                cause = f"scaled by {y.mass / x.mass:.6g}" if x.mass > 0 and y.mass > 0 else "left out"
                yield Difference("mass", f"{where}, <inertial><mass>", x.mass, y.mass, cause)
            if centre:
                yield Difference("centre of mass", f"{where}, <inertial><origin xyz>", x.centre, y.centre,
                                 centre_cause(x, y, self.tolerance * self.a.size))  # fmt: skip
            if inertia:
                near = inertia_tolerance(x.mass, x.inertia, self.a.size, self.tolerance)
                cause, attribute = inertia_cause(x, y, near)
                yield Difference("inertia", f"{where}, {attribute}", x.inertia, y.inertia, cause)

    def _unequal(self, x: LinkInertia, y: LinkInertia) -> tuple[bool, bool, bool]:
        """Three flags, true if mass, centre of mass and inertia differ."""
        near = inertia_tolerance(x.mass, x.inertia, self.a.size, self.tolerance)
        return (
            bool(abs(x.mass - y.mass) > self.tolerance * max(x.mass, y.mass)),
            bool(np.abs(x.centre - y.centre).max() > self.tolerance * self.a.size and min(x.mass, y.mass) > 0),
            bool(np.abs(x.inertia - y.inertia).max() > near),
        )

    def _numbers(self, m: Match) -> Iterator[Difference]:
        """Limits, damping, friction and armature of a joint, as far as it has them."""
        if self.a.screws[m.a].shape != self.b.screws[m.b].shape or not self.a.screws[m.a].size:
            return
        ours, theirs = (_constants(s.model, j) for s, j in ((self.a, m.a), (self.b, m.b)))
        mapped = dict(theirs)
        if "lower limit" in theirs:
            ends = [m.sign * theirs[key] + m.offset for key in ("lower limit", "upper limit")]
            mapped |= dict(zip(("lower limit", "upper limit"), ends[:: int(m.sign)], strict=True))
        for what in _ATTRIBUTES:
            x, y = ours.get(what, 0.0), theirs.get(what, 0.0)
            near = self.tolerance * max(abs(x), abs(y), 1.0 if "limit" in what else 0.0)  # 1: zeros may be displaced
            # Limits that are as written although the joint's zero or sign is another one are no second fault.
            if not any(x == z or abs(x - z) <= near for z in (y, mapped.get(what, 0.0))):
                yield Difference(what, self._joint(m, _ATTRIBUTES[what]), x, y, _number_cause(x, y))

    def _gravity(self) -> list[Difference]:
        ours, theirs = (np.array(side.model.gravity.linear) for side in (self.a, self.b))
        equal = np.allclose(ours, theirs, rtol=self.tolerance, atol=self.tolerance)
        return [] if equal else [Difference("gravity", self.labels[1], ours, theirs, "another field")]

    def _joint(self, m: Match, attribute: str) -> str:
        return f"{self.labels[1]}, joint {self.b.model.names[m.b]!r}, {attribute}"


def _in_world(body: pin.Inertia) -> LinkInertia:
    return LinkInertia(float(body.mass), np.array(body.lever), np.array(body.inertia), np.eye(3))


def _constants(model: pin.Model, joint: int) -> dict[str, float]:
    """The numbers of a joint, those of its first degree of freedom; infinite where there is no limit."""
    q, v = model.idx_qs[joint], model.idx_vs[joint]
    numbers = {"damping": model.damping[v], "friction": model.upperDryFrictionLimit[v], "armature": model.armature[v]}
    if model.nvs[joint] == 1:
        numbers |= {"velocity limit": model.velocityLimit[v], "effort limit": model.upperEffortLimit[v]}
    if model.nqs[joint] == 1:
        numbers |= {"lower limit": model.lowerPositionLimit[q], "upper limit": model.upperPositionLimit[q]}
    return {name: float(x) if abs(x) < NO_LIMIT else math.copysign(math.inf, x) for name, x in numbers.items()}


def _number_cause(x: float, y: float) -> str:
    if y == 0:
        return "left out in b"
    if x == 0:
        return "not in a"
    if not math.isfinite(x) or not math.isfinite(y):
        return "no limit in " + ("a" if math.isinf(x) else "b")
    for factor, words in ((180 / math.pi, "degrees for radians"), (math.pi / 180, "radians taken for degrees"),
                          (-1.0, "the sign"), (1e3, "a factor of 1000"), (1e-3, "a factor of 1000")):  # fmt: skip
        if abs(y - factor * x) <= 1e-4 * abs(factor * x):
            return words
    return "another number"


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=5, separator=" ").replace("\n", "")
    return f"{value:.6g}" if isinstance(value, float) else str(value)
