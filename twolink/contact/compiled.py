"""Scenes whose steps the native library takes, and these as arrays for it (`native/contact/scene.c`).

It takes those of all joints, with stops, dry friction and loops. It finds the points of shapes on planes and on
height fields, of shapes that touch at one point that has a formula, and of boxes and meshes with few edges; those of
others it asks the detector for. NumPy (`stepping`), whose law this is, takes all other scenes, single
steps that the library does not find, and all steps where there is no library.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
import pinocchio as pin

from twolink.algorithms.joint_models import read_joint
from twolink.contact.bodies import Multibody
from twolink.contact.joints import JointPoints, Laws, LoopRows
from twolink.geometry.detection import ByFormula, Detector, Hulls
from twolink.geometry.fields import FieldSurface
from twolink.geometry.gaps import BoxGap, CylinderGap, RimGap
from twolink.geometry.hulls import FEW, Hull, hull_of
from twolink.geometry.on_world import Group, OnFields, OnPlanes, RimsOnPlanes, bounding_radius
from twolink.geometry.pairs import gaps_of, half_of, middle_of
from twolink.geometry.points import Links, Places, Points, joined
from twolink.integrate.motion.state import Array
from twolink.native.contact import ContactScene, Parts, runs_alone
from twolink.native.library import library
from twolink.robots.collisions import Box, Capsule, Convex, Cylinder, Solid, Sphere

KINDS = ("free-flyer", "spherical", "planar", "revolute", "continuous", "prismatic")
GROUPS = (OnPlanes, RimsOnPlanes, OnFields, ByFormula)  # and those of hulls with few edges
ROUND, HULL = (Sphere, Capsule, Cylinder), 3  # kinds of bodies over height fields
CORNERS = 128  # of a face, half of MOST_CORNERS in `native/contact/hulls.c`
ENDLESS = 1e300  # m: the thickness of what has none


def compiled(
    bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws, loops: LoopRows | None
) -> ContactScene | None:
    """The scene in the native library; None where NumPy takes its steps."""
    if library() is None or not is_covered(bodies, loops):
        return None
    others = [group for group in detector.groups if not is_found_natively(group)]
    finder = OtherPoints(detector.links, others) if others else None
    return ContactScene(parts_of(bodies, detector, joints, laws, loops), finder, misses=not detector.sees_all)


def parts_of(bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws, loops: LoopRows | None) -> Parts:
    """The scene as arrays."""
    sizes, whole, numbers = _Scene(bodies, detector, joints, laws).arrays()
    rows, program = (0, None) if loops is None else (len(loops.constraints.kept), loops.function)
    return Parts([*sizes, rows], whole, numbers, bodies.program, program)


def is_covered(bodies: Multibody, loops: LoopRows | None) -> bool:
    """True if the native library takes the steps of a scene: those of effects that it has as programs."""
    programs = [bodies.program] if bodies.equations.effects else []
    programs += [] if loops is None else [loops.function]
    return all(one is not None and runs_alone(one) for one in programs)


def is_found_natively(group: Group) -> bool:
    """True if the native library finds the points of a group."""
    if type(group) is Hulls:
        few = all(_edges(group, a) * _edges(group, b) <= FEW for a, b in group.ends.tolist())
        return few and all(len(face) <= CORNERS for i in np.unique(group.ends) for face in group.hull(int(i)).faces)
    return type(group) in GROUPS


class OtherPoints:
    """Points that the detector's groups find for the native library."""

    def __init__(self, links: Links, groups: Sequence[Group]) -> None:
        self._links, self._groups = links, groups

    def points(self, rotations: Array, origins: Array, reach: float) -> Points:
        """The points with gaps below the reach, by their pairs."""
        links = self._links.at(Places(rotations, origins))
        points = joined(group.points(links, reach) for group in self._groups)
        return points.taken(np.argsort(points.pair, kind="stable"))

    def overlap(self, rotations: Array, origins: Array) -> float:
        """The largest overlap, m."""
        links = self._links.at(Places(rotations, origins))
        return max((depth for group in self._groups for depth, _ in group.overlaps(links)), default=0.0)


def _edges(group: Hulls, number: int) -> int:
    return len(group.hull(number).edges)


class _Scene:
    """The arrays of a scene, of which each part is a list of rows."""

    def __init__(self, bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws) -> None:
        self.bodies, self.detector, self.joints, self.laws = bodies, detector, joints, laws
        self.model = bodies.model
        self._places: dict[str, tuple[int, Array, Array]] = {}
        self._points: dict[Any, list[float]] = {}
        self._solids: dict[int, tuple[int, Solid]] = {}  # boxes and meshes, with their numbers

    def arrays(self) -> tuple[list[int], Array, Array]:
        """The sizes, the whole numbers and the numbers."""
        balls, planes, rims = self._on_planes()
        fields, on_fields = self._on_fields()
        rounds = [self._rounds(cast(ByFormula, group)) for group in self._groups(ByFormula)]
        rows = [*planes, *rims, *fields, *on_fields, *rounds]
        pairs = [[int(pair), *map(self._solid, (group.solids[i] for i in ends))]
                 for group in cast(Iterable[Hulls], self._groups(Hulls))
                 for pair, ends in zip(group.pair, group.ends.tolist(), strict=True)]  # fmt: skip
        hulls, solids = self._hulls()
        laws, (stops, ways) = self.laws, self._joints()
        model, viscosity = self.model, self.bodies.viscosity
        sizes = [model.njoints, model.nq, model.nv, self._numbers(), len(self.detector.names), sum(map(len, balls)),
                 len(planes), len(rims), len(fields), len(on_fields), sum(len(row[0]) for row in rounds), len(hulls),
                 len(solids), len(pairs), len(stops)]  # fmt: skip
        thickness = np.where(np.isfinite(laws.thickness), laws.thickness, ENDLESS)
        of_bodies, of_joints = self._bodies()
        whole = [of_bodies, *(one[:, 0] for one in balls), *(row[0] for row in rows),
                 *(_whole_of(hull) for hull in hulls), *(row[0] for row in solids), *pairs, *stops]  # fmt: skip
        numbers = [model.gravity.linear, of_joints, model.armature, viscosity,
                   *(one[:, k] for k in range(1, 5) for one in balls), *(row[1] for row in rows),
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
        return (group for group in self.detector.groups if type(group) is kind and is_found_natively(group))

    def _placed(self, link: str) -> tuple[int, Array, Array]:
        """The joint that carries a link, and the link's pose in its axes."""
        if link not in self._places:
            frame = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
            self._places[link] = int(frame.parentJoint), frame.placement.rotation, frame.placement.translation
        return self._places[link]

    def _at(self, link: str, point: Any, *, turned: bool = False) -> list[float]:
        """A point of a link in the axes of its joint; a direction where it is only turned."""
        key = link, tuple(point), turned
        if key not in self._points:
            _, rotation, origin = self._placed(link)
            out = rotation @ np.array(point, dtype=float)
            self._points[key] = (out if turned else out + origin).tolist()
        return self._points[key]

    def _on_planes(self) -> tuple[list[Any], list[Any], list[Any]]:
        """Balls (feature, x, y, z, radius), and bodies over planes and rims as pairs of whole numbers and numbers."""
        balls, planes, count = list[Array](), list[Any](), 0
        for group in self._groups(OnPlanes):
            on_planes = cast(OnPlanes, group)
            for rows in np.split(np.arange(len(on_planes.pair)), on_planes.first[1:]):
                own, plane = self._on_plane(on_planes, rows, count)
                balls.append(own)
                planes.append(plane)
                count += len(rows)
        rims = [self._rim(*row) for group in self._groups(RimsOnPlanes) for row in _rims_of(cast(RimsOnPlanes, group))]
        return balls, planes, rims

    def _on_plane(self, group: OnPlanes, rows: Array, first: int) -> tuple[Array, tuple[Any, Any]]:
        """The balls of a body over a plane, and the body; first: the number of the first ball."""
        one, gap = int(rows[0]), group.every
        joint, rotation, origin = self._placed(group.bodies[int(group.solid[one])])
        x, radii = gap.ball.point[:, rows].T @ rotation.T + origin, gap.ball.radius[rows]
        centre = x.mean(axis=0)
        bound = float((np.linalg.norm(x - centre, axis=1) + radii).max())
        whole = [int(group.pair[one]), joint, first, first + len(rows)]
        numbers = [*gap.normal[:, one].tolist(), float(gap.height[one]), *centre.tolist(), bound]
        return np.column_stack([group.feature[rows], x, radii]), (whole, numbers)

    def _rim(self, pair: int, feature: int, gap: RimGap) -> tuple[Any, Any]:
        joint, point = self._placed(gap.link)[0], self._at(gap.link, gap.point)
        axis = self._at(gap.link, gap.axis, turned=True)
        return [pair, joint, feature], [*gap.normal, gap.height, *point, *axis, gap.radius]

    def _on_fields(self) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
        """Height fields, and bodies over them."""
        groups = [cast(OnFields, group) for group in self._groups(OnFields)]
        surfaces = list(dict.fromkeys(surface for group in groups for surface in group.surfaces))
        bodies = [self._on_field(solid, pair, surfaces.index(surface)) for group in groups
                  for solid, pair, surface in zip(group.solids, group.pair.tolist(), group.surfaces, strict=True)
                  ]  # fmt: skip
        return [_field(surface) for surface in surfaces], bodies

    def _on_field(self, solid: Solid, pair: int, field: int) -> tuple[list[int], list[float]]:
        """A body over a height field: a solid, or the ends of an axis with a radius."""
        shape, joint = solid.shape, self._placed(solid.link)[0]
        if isinstance(shape, (Box, Convex)):
            return [HULL, pair, joint, field, self._solid(solid)], [0.0] * 7
        half = 0.5 * float(getattr(shape, "length", 0.0)) * shape.placement.rotation[:, 2]
        ends = [x for side in (-1.0, 1.0) for x in self._at(solid.link, shape.placement.translation + side * half)]
        kind = ROUND.index(type(shape)) if half.any() else 0
        return [kind, pair, joint, field], [*ends, shape.radius]

    def _solid(self, solid: Solid) -> int:
        """The number of a box or mesh."""
        return self._solids.setdefault(id(solid), (len(self._solids), solid))[0]

    def _rounds(self, group: ByFormula) -> tuple[Array, Array]:
        """Of each pair its row of whole numbers, and of numbers."""
        bounds = group.bounds[group.ends].sum(axis=1)
        if all(isinstance(solid.shape, (Sphere, Capsule)) for solid in group.solids):
            joint, middle, radius, half = (np.array(each) for each in zip(*map(self._ball, group.solids), strict=True))
            first, second = group.ends.T
            whole = [np.zeros_like(first), group.pair, joint[first], joint[second]]
            return np.column_stack(whole), np.column_stack([
                middle[first], middle[second], radius[first], radius[second], half[first], half[second],
                np.zeros((len(first), 12)), bounds])  # fmt: skip
        gaps = (gaps_of(pair)[0] for pair in group.pairs)
        wholes, numbers = zip(*map(self._round, group.pair.tolist(), gaps, bounds.tolist()), strict=True)
        return np.array(wholes), np.array(numbers)

    def _ball(self, solid: Solid) -> tuple[int, list[float], float, list[float]]:
        """Of a ball or capsule its joint, its middle, its radius, and the way from there to an end."""
        ball, way = middle_of(solid), self._at(solid.link, half_of(solid), turned=True)
        return self._placed(solid.link)[0], self._at(solid.link, ball.point), ball.radius, way

    def _round(self, pair: int, gap: Any, bound: float) -> tuple[list[int], list[float]]:
        """A ball, the first body, and a box or a cylinder, the second."""
        none, ball, other = [0.0] * 3, gap.ball, gap.frame
        if isinstance(gap, BoxGap):
            kind, edges = 1, list(gap.half)
            axes = [x for axis in gap.axes for x in self._at(other, axis, turned=True)]
        else:
            cylinder = cast(CylinderGap, gap)
            kind, edges = 2, [cylinder.radius, cylinder.half, 0.0]
            axes = [*self._at(other, cylinder.axis, turned=True), *none, *none]
        places = [*self._at(ball.frame, ball.point), *self._at(other, gap.point)]
        first, second = self._placed(ball.frame)[0], self._placed(other)[0]
        return [kind, pair, first, second], [*places, ball.radius, 0.0, *none, *none, *axes, *edges, bound]

    def _hulls(self) -> tuple[list[Hull], list[tuple[Any, Any]]]:
        """Hulls, and solids that have their shapes."""
        hulls, solids = dict[int, tuple[int, Hull]](), list[tuple[Any, Any]]()
        for _, solid in self._solids.values():
            hull, place = hull_of(cast(Box | Convex, solid.shape)), solid.shape.placement
            number, _ = hulls.setdefault(id(hull), (len(hulls), hull))
            joint, rotation, origin = self._placed(solid.link)
            solids.append(([joint, number], _joined([rotation @ place.rotation, rotation @ place.translation + origin,
                                                     bounding_radius(solid.shape)])))  # fmt: skip
        return [hull for _, hull in hulls.values()], solids

    def _joints(self) -> tuple[list[list[int]], list[list[float]]]:
        """Stops and dry friction of joints."""
        stops, locks = self.joints.stops, self.joints.locks
        whole = [*([1, stop.entry, stop.dof] for stop in stops), *([0, 0, lock.dof] for lock in locks)]
        return whole, [*([float(stop.position), float(stop.side)] for stop in stops), *([0.0, 1.0] for _ in locks)]


def _field(one: FieldSurface) -> tuple[Any, Any]:
    whole = [*one.heights.shape, *one.marks.ravel(), *one.plane_of.ravel()]
    return whole, [*one.cell, *one.origin, one.top, *one.heights.ravel()]


def _rims_of(group: RimsOnPlanes) -> Iterable[tuple[int, int, RimGap]]:
    return zip(group.pair.tolist(), group.feature.tolist(), group.gaps, strict=True)


def _whole_of(hull: Hull) -> Array:
    starts = [*hull.starts, len(hull.inward)]
    return _joined([[len(hull.vertices), len(hull.faces), len(hull.edges), len(hull.inward)], hull.edges, hull.sides,
                    starts, *hull.faces])  # fmt: skip


def _numbers_of(hull: Hull) -> Array:
    return _joined([hull.vertices, hull.normals, hull.heights, hull.ways, hull.inward, hull.depths])


def _joined(parts: Sequence[Any]) -> Array:
    """All numbers of the parts, one behind the other."""
    return np.concatenate([np.zeros(0), *(np.ravel(np.asarray(part, dtype=float)) for part in parts)])
