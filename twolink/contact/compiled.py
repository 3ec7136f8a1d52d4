"""Scenes whose steps the native library takes, and these as arrays for it (`native/contact_scene.c`).

It takes those of robots of all joints but mimic ones, whose shapes touch planes, and each other where that has a
formula or where both are boxes or meshes with few edges; with stops and dry friction of joints, but without loops.
NumPy (`stepping`), whose law this is, takes all others, single steps that the library does not find, and all steps
where there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
import pinocchio as pin

from twolink.algorithms.joint_models import read_joint
from twolink.contact.bodies import Multibody
from twolink.contact.joints import JointPoints, Laws
from twolink.errors import QueryError
from twolink.geometry.detection import ByFormula, Detector, Hulls
from twolink.geometry.gaps import BoxGap, CylinderGap, PlaneGap, RimGap, RoundGap
from twolink.geometry.hulls import FEW, Hull
from twolink.geometry.on_world import Group, OnPlanes, RimsOnPlanes, bounding_radius
from twolink.geometry.pairs import gaps_of
from twolink.integrate.motion.state import Array
from twolink.native.contact import ContactScene, Parts, runs_alone
from twolink.native.library import library

KINDS = ("free-flyer", "spherical", "planar", "revolute", "continuous", "prismatic")
GROUPS = (OnPlanes, RimsOnPlanes, ByFormula, Hulls)
ENDLESS = 1e300  # m: the thickness of what has none


def compiled(bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws) -> ContactScene | None:
    """The scene in the native library; None where NumPy takes its steps."""
    if not is_covered(bodies, detector):
        return None
    sizes, whole, numbers = _Scene(bodies, detector, joints, laws).arrays()
    return ContactScene(Parts(sizes, whole, numbers, bodies.program))


def is_covered(bodies: Multibody, detector: Detector) -> bool:
    """True if the native library takes the steps of a scene without loops."""
    if library() is None or any(type(group) not in GROUPS for group in detector.groups):
        return False
    if bodies.equations.effects and (bodies.program is None or not runs_alone(bodies.program)):
        return False
    for group in detector.groups:
        if type(group) is Hulls and any(_edges(group, a) * _edges(group, b) > FEW for a, b in group.ends.tolist()):
            return False
    try:
        return not any(read_joint(bodies.model, i).mimic for i in range(1, bodies.model.njoints))
    except QueryError:  # a joint that formulas do not know
        return False


def _edges(group: Hulls, number: int) -> int:
    return len(group.hull(number).edges)


class _Scene:
    """The arrays of a scene, of which each part is a list of rows."""

    def __init__(self, bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws) -> None:
        self.bodies, self.detector, self.joints, self.laws = bodies, detector, joints, laws
        self.model = bodies.model

    def arrays(self) -> tuple[list[int], Array, Array]:
        """The sizes, the whole numbers and the numbers."""
        balls, planes, rims = self._on_planes()
        rounds = [row for group in self._groups(ByFormula) for row in self._rounds(cast(ByFormula, group))]
        hulls, solids, pairs = self._hulls()
        laws, (stops, ways) = self.laws, self._joints()
        model, viscosity = self.model, self.bodies.viscosity
        sizes = [model.njoints, model.nq, model.nv, self._numbers(), len(self.detector.names), len(balls), len(planes),
                  len(rims), len(rounds), len(hulls), len(solids), len(pairs), len(stops)]  # fmt: skip
        thickness = np.where(np.isfinite(laws.thickness), laws.thickness, ENDLESS)
        of_bodies, of_joints = self._bodies()
        whole = [of_bodies, [row[0] for row in balls], *(row[0] for row in (*planes, *rims, *rounds)),
                 *(_whole_of(hull) for hull in hulls), *(row[0] for row in solids), *pairs, *stops]  # fmt: skip
        numbers = [model.gravity.linear, of_joints, model.armature, viscosity,
                   np.array([row[1:] for row in balls]).T, *(row[1] for row in (*planes, *rims, *rounds)),
                   *(_numbers_of(hull) for hull in hulls), *(row[1] for row in solids), *ways, laws.friction,
                   laws.static, laws.restitution, laws.threshold, thickness, laws.pressing]  # fmt: skip
        return sizes, _joined(whole).astype(np.int32), _joined(numbers)

    def _numbers(self) -> int:
        """The number of numbers that the program takes behind the velocity."""
        program = self.bodies.program
        return 0 if program is None else program.inputs - 1 - self.model.nq - self.model.nv

    def _bodies(self) -> tuple[list[int], Array]:
        """Of each body its joint's kind, parent, and places in q and v; and its numbers."""
        model, whole, numbers = self.model, list[int](), list[Any]()
        for i in range(1, model.njoints):
            joint, place, body = read_joint(model, i), model.jointPlacements[i], model.inertias[i]
            whole += [KINDS.index(joint.kind), int(model.parents[i]), joint.entries[0], joint.dofs[0]]
            axis = [0.0, 0.0, 0.0] if len(joint.dofs) > 1 else [float(x) for x in joint.axis]
            numbers += [axis, place.rotation, place.translation, body.mass, body.lever, body.inertia,
                        self.detector.extent[i]]  # fmt: skip
        return whole, _joined(numbers)

    def _groups(self, kind: type[Group]) -> Iterable[Group]:
        return (group for group in self.detector.groups if type(group) is kind)

    def _placed(self, link: str) -> tuple[int, Array, Array]:
        """The joint that carries a link, and the link's pose in its axes."""
        frame = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
        return int(frame.parentJoint), frame.placement.rotation, frame.placement.translation

    def _on_planes(self) -> tuple[list[Any], list[Any], list[Any]]:
        """Balls (feature, x, y, z, radius), and bodies over planes and rims as pairs of whole numbers and numbers."""
        balls, planes, rims = list[Any](), list[Any](), list[Any]()
        for group in (*self._groups(OnPlanes), *self._groups(RimsOnPlanes)):
            of_pairs: dict[int, list[tuple[int, Any]]] = {}
            for pair, feature, gap in zip(group.pair.tolist(), group.feature.tolist(), group.gaps, strict=True):  # type: ignore[attr-defined]
                of_pairs.setdefault(pair, []).append((feature, gap))
            for pair, gaps in of_pairs.items():
                if type(group) is RimsOnPlanes:
                    rims += [self._rim(pair, feature, gap) for feature, gap in gaps]
                else:
                    own, plane = self._on_plane(pair, gaps, len(balls))
                    balls += own
                    planes.append(plane)
        return balls, planes, rims

    def _on_plane(self, pair: int, gaps: list[tuple[int, PlaneGap]], first: int) -> tuple[list[Any], tuple[Any, Any]]:
        """The balls of a body over a plane, and the body; first: the number of the first ball."""
        one = gaps[0][1]
        joint, rotation, origin = self._placed(one.ball.frame)
        x = np.array([gap.ball.point for _, gap in gaps], dtype=float) @ rotation.T + origin
        radii = np.array([gap.ball.radius for _, gap in gaps])
        centre = x.mean(axis=0)
        bound = float((np.linalg.norm(x - centre, axis=1) + radii).max())
        rows = [
            (feature, *at, radius) for (feature, _), at, radius in zip(gaps, x.tolist(), radii.tolist(), strict=True)
        ]
        return rows, ([pair, joint, first, first + len(rows)], [*one.normal, one.height, *centre, bound])

    def _rim(self, pair: int, feature: int, gap: RimGap) -> tuple[Any, Any]:
        joint, rotation, origin = self._placed(gap.link)
        point, axis = rotation @ np.array(gap.point) + origin, rotation @ np.array(gap.axis)
        return [pair, joint, feature], [*gap.normal, gap.height, *point, *axis, gap.radius]

    def _rounds(self, group: ByFormula) -> Iterable[tuple[Any, Any]]:
        for k, pair in enumerate(group.pairs):
            (gap,) = gaps_of(pair)
            bound = float(group.bounds[group.ends[k]].sum())
            yield self._round(int(group.pair[k]), gap, bound)

    def _round(self, pair: int, gap: Any, bound: float) -> tuple[Any, Any]:
        """A ball or capsule, the first body, and another shape, the second."""
        ball = gap.first if isinstance(gap, RoundGap) else gap.ball
        other = gap.second.frame if isinstance(gap, RoundGap) else gap.frame
        (first, r, p), (second, s, o) = self._placed(ball.frame), self._placed(other)
        centre, axes, edges, radius = r @ np.array(ball.point, float) + p, np.zeros((3, 3)), np.zeros(3), 0.0
        halves = np.zeros((2, 3))
        if isinstance(gap, RoundGap):
            kind, point, radius = 0, gap.second.point, gap.second.radius
            halves = np.array([r @ np.array(gap.first_half, float), s @ np.array(gap.second_half, float)])
        elif isinstance(gap, BoxGap):
            kind, point, edges, axes = 1, gap.point, np.array(gap.half), np.array(gap.axes) @ s.T
        else:
            cylinder = cast(CylinderGap, gap)
            kind, point, edges = 2, cylinder.point, np.array([cylinder.radius, cylinder.half, 0.0])
            axes[0] = s @ np.array(cylinder.axis)
        numbers = [centre, s @ np.array(point, float) + o, [ball.radius, radius], halves, axes, edges, bound]
        return [kind, pair, first, second], _joined(numbers)

    def _hulls(self) -> tuple[list[Hull], list[tuple[Any, Any]], list[list[int]]]:
        """Hulls, solids that have their shapes, and pairs of solids."""
        hulls, solids, pairs = dict[int, Hull](), list[tuple[Any, Any]](), list[list[int]]()
        for one in self._groups(Hulls):
            group = cast(Hulls, one)
            first, places = len(solids), list(hulls)
            for i, solid in enumerate(group.solids):
                hull = group.hull(i)
                hulls.setdefault(id(hull), hull)
                places = list(hulls)
                joint, rotation, origin = self._placed(solid.link)
                at = rotation @ group.origins[:, i] + origin
                solids.append(([joint, places.index(id(hull))],
                               _joined([rotation @ group.rotations[i], at, bounding_radius(solid.shape)])))  # fmt: skip
            pairs += [[int(pair), first + a, first + b]
                      for pair, (a, b) in zip(group.pair.tolist(), group.ends.tolist(), strict=True)]  # fmt: skip
        return list(hulls.values()), solids, pairs

    def _joints(self) -> tuple[list[list[int]], list[list[float]]]:
        """Stops and dry friction of joints."""
        stops, holds = self.joints.stops, self.joints.holds
        whole = [*([1, stop.entry, stop.dof] for stop in stops), *([0, 0, hold.dof] for hold in holds)]
        return whole, [*([float(stop.position), float(stop.side)] for stop in stops), *([0.0, 1.0] for _ in holds)]


def _whole_of(hull: Hull) -> Array:
    starts = [*hull.starts, len(hull.inward)]
    return _joined([[len(hull.vertices), len(hull.faces), len(hull.edges), len(hull.inward)], hull.edges, hull.sides,
                    starts, *hull.faces])  # fmt: skip


def _numbers_of(hull: Hull) -> Array:
    return _joined([hull.vertices, hull.normals, hull.heights, hull.ways, hull.inward, hull.depths])


def _joined(parts: Sequence[Any]) -> Array:
    """All numbers of the parts, one behind the other."""
    return np.concatenate([np.zeros(0), *(np.ravel(np.asarray(part, dtype=float)) for part in parts)])
