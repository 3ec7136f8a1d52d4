"""Pairs of a robot's bodies that may touch: those that a scene names, and what "self" and "ground" stand for."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import pinocchio as pin

from twolink.algorithms.functions import frame_pose
from twolink.effects.checks import check_fields
from twolink.effects.effect import check_name
from twolink.errors import SceneError
from twolink.geometry.fields import HeightField
from twolink.geometry.pairs import Pair, Plane
from twolink.io.fingerprints import joint_poses
from twolink.robots.collisions import AnyShape, Capsule, Convex, Solid, Sphere, collision_model
from twolink.robots.convex_parts import convex_parts

if TYPE_CHECKING:
    from twolink.dynamics import Robot

SELF, GROUND = "self", "ground"
TOUCHING = 1e-9  # m: what counts as no distance


World = Plane | HeightField  # what is fixed to the world and belongs to no link
Body = str | World
Labels = dict[tuple[str, str], str]
LEVEL = Plane()


class Pairs(NamedTuple):
    """The pairs of a scene. excluded: those of "self" that may not touch, with the reason."""

    chosen: tuple[Pair, ...]
    excluded: tuple[tuple[str, str], ...]


def solids_of(
    robot: Robot, given: Mapping[str, Sequence[AnyShape]], concavity: float | None = None
) -> tuple[Solid, ...]:
    """The shapes of a robot: of its URDF, or for some links given ones. concavity: m, see `Contact`."""
    solids = list(robot.solids_besides(given))
    if concavity is not None:
        solids = [part for solid in solids for part in convex_parts(solid, concavity)]
    links = robot.frame_names
    for link, shapes in given.items():
        check_name(link, links, f"shapes.{link}", "link")
        for k, shape in enumerate(shapes):
            if isinstance(shape, Convex) and not shape.vertices:
                raise SceneError("it has no vertices", where=f"shapes.{link}[{k}].vertices", remedy="give some points")
        solids += [Solid(f"{link}_{k}", link, shape) for k, shape in enumerate(shapes)]
    return tuple(solids)


def select_pairs(
    robot: Robot, solids: Sequence[Solid], asked: Sequence[str | tuple[Body, Body]], margin: float = 0.0,
    exclude: Sequence[tuple[Body, Body]] = (),
) -> Pairs:  # fmt: skip
    """The pairs that a scene asks for, but for those to exclude. margin: of "self" those nearer than this at rest are
    left out, m.

    Raises SceneError for names that do not exist and bodies that never meet.
    """
    if not solids:
        raise SceneError("no link of the robot has a collision shape", where="pairs",
                         remedy="add <collision> elements to the URDF, or objects first, or give shapes=",
                         code="no-shapes")  # fmt: skip
    chosen: dict[tuple[int, object], Pair] = {}
    labels = labels_of(solids)
    named = _by_names(solids, labels)
    excluded: list[tuple[str, str]] = []
    if not isinstance(asked, (tuple, list)):
        raise SceneError(f"expected pairs of bodies, {SELF!r} or {GROUND!r}, got {asked!r:.60}", where="pairs",
                         remedy='such as [("foot", "ground")]')  # fmt: skip
    for i, item in enumerate(asked):
        if item == SELF:
            allowed, not_allowed = _own_pairs(robot, solids, labels, margin)
            excluded += not_allowed
        elif item == GROUND:
            allowed = [_pair(labels, solid, LEVEL) for solid in solids if _body(robot, solid)]
        else:
            allowed = _named_pairs(robot, named, labels, item, f"pairs[{i}]")
        for pair in allowed:
            chosen.setdefault(_key(pair), pair)
    for i, item in enumerate(exclude):
        for pair in _named_pairs(robot, named, labels, item, f"exclude[{i}]"):
            if chosen.pop(_key(pair), None):
                excluded.append((pair.name, "by the scene"))
    if not chosen:
        why = f" ({excluded[0][0]}: {excluded[0][1]})" if excluded else ""
        raise SceneError(f"no two bodies may touch{why}", where="pairs", code="no-pairs",
                         remedy="name two bodies, or leave the effect out")  # fmt: skip
    return Pairs(tuple(_numbered(chosen.values())), tuple(excluded))


def _numbered(pairs: Iterable[Pair]) -> list[Pair]:
    """The pairs, with numbered planes where there are several: "ball - plane 2"."""
    found = list(pairs)
    planes = list(dict.fromkeys(one.second for one in found if isinstance(one.second, World) and one.second != LEVEL))
    if len(planes) < 2:
        return found
    number = {plane: f" {k + 1}" for k, plane in enumerate(planes)}
    return [one._replace(name=one.name + number.get(one.second, "")) if isinstance(one.second, World) else one
            for one in found]  # fmt: skip


def _key(pair: Pair) -> tuple[int, object]:
    """The key that two equal pairs have in common, in whichever order their bodies were named."""
    first, second = id(pair.first), pair.second if isinstance(pair.second, World) else id(pair.second)
    return (first, second) if isinstance(second, World) else (min(first, second), max(first, second))


def hollow_notes(pairs: Pairs) -> list[str]:
    """Notes on meshes: their numbers of convex parts, and what the convex hulls of others fill, the deepest first."""
    meshes = {id(solid): solid.name for pair in pairs.chosen for solid in (pair.first, pair.second)
              if isinstance(solid, Solid) and solid.mesh}  # fmt: skip
    parts = ", ".join(f"{name} {count}" for name, count in Counter(meshes.values()).items() if count > 1)
    lines = [f"meshes count as convex parts: {parts}"] * bool(parts)
    found = {solid.name: solid.hollow for pair in pairs.chosen for solid in (pair.first, pair.second)
             if isinstance(solid, Solid) and solid.hollow}  # fmt: skip
    deepest = sorted(found.items(), key=lambda item: -item[1])
    listed = ", ".join(f"{name} {depth:.2g} m" for name, depth in deepest[:8]) + (", ..." if len(found) > 8 else "")
    hulls = f"{len(found)} meshes count as their convex hulls, below which their surfaces lie: {listed}"
    return [*lines, hulls] if found else lines


def _own_pairs(
    robot: Robot, solids: Sequence[Solid], labels: Labels, margin: float
) -> tuple[list[Pair], list[tuple[str, str]]]:
    """The robot's own pairs that may touch, and the others: adjacent links, and shapes that overlap at rest.

    Bodies that only a joint of three directions or more connects, such as a free one, are neither: they are separate.
    """
    model, allowed, excluded = robot.model, list[Pair](), list[tuple[str, str]]()
    geometry, poses = collision_model(model, solids).geometryObjects, joint_poses(model, robot.neutral)
    bodies = [_body(robot, solid) for solid in solids]
    free = {body: [j for j in model.supports[body] if _is_free(model, j)] for body in set(bodies)}
    for i, k in itertools.combinations(range(len(solids)), 2):
        a, b = bodies[i], bodies[k]
        if a == b:
            continue
        if frozenset((solids[i].link, solids[k].link)) in robot.visuals.srdf.apart:
            excluded.append((f"{solids[i].link} - {solids[k].link}", f"by {robot.visuals.srdf.file}"))
            continue
        pair, separate = _pair(labels, solids[i], solids[k]), free[a] != free[b]
        if not separate and len(_joints_between(model, a, b)) == 1:
            excluded.append((pair.name, "adjacent"))
        elif not separate and _overlap(geometry, poses, i, k, margin):
            excluded.append((pair.name, f"within {margin:g} m at rest" if margin else "overlap at rest"))
        else:
            allowed.append(pair)
    return allowed, excluded


def _overlap(geometry: Sequence[pin.GeometryObject], poses: Sequence[pin.SE3], i: int, k: int, margin: float) -> bool:
    """True if shapes are nearer than a margin, m. Those that touch, such as Newton's cradle, have the distance 0."""
    import coal

    placed = [(item, poses[item.parentJoint] * item.placement) for item in (geometry[i], geometry[k])]
    (a, p), (b, q) = [(item.geometry, coal.Transform3s(at.rotation, at.translation)) for item, at in placed]
    distance = float(coal.distance(a, p, b, q, coal.DistanceRequest(), coal.DistanceResult()))
    return distance < margin - TOUCHING


def _by_names(solids: Sequence[Solid], labels: Labels) -> list[dict[str, list[Solid]]]:
    """The solids of each link, of each name of their own, and of each label."""
    kinds: list[dict[str, list[Solid]]] = [{}, {}, {}]
    for one in solids:
        for kind, name in zip(kinds, (one.link, one.name, labels[one.link, one.name]), strict=True):
            kind.setdefault(name, []).append(one)
    return kinds


def _named_pairs(
    robot: Robot, named: Sequence[Mapping[str, list[Solid]]], labels: Labels, item: object, where: str
) -> list[Pair]:
    """Every shape of one named body with every shape of the other."""
    if isinstance(item, str) or not (isinstance(item, (tuple, list)) and len(item) == 2):
        raise SceneError(f"expected two bodies, {SELF!r} or {GROUND!r}, got {item!r:.60}", where=where,
                         remedy='such as ("foot", "ground") or ("palm", "cube")')  # fmt: skip
    first, second = (_named(robot, named, body, f"{where}[{k}]") for k, body in enumerate(item))
    if isinstance(first, World):
        first, second = second, first
    if isinstance(first, World):
        raise SceneError("two planes do not touch", where=where, remedy="name a link of the robot")
    seconds = [second] if isinstance(second, World) else second
    pairs = [(a, b) for a in first for b in seconds
             if _body(robot, a) != (0 if isinstance(b, World) else _body(robot, b))]  # fmt: skip
    if not pairs:
        raise SceneError("the two bodies do not move against each other", where=where, remedy="name links that do")
    return [_pair(labels, a, b) for a, b in pairs]


def _named(robot: Robot, named: Sequence[Mapping[str, list[Solid]]], body: Body, where: str) -> list[Solid] | World:
    if isinstance(body, HeightField):
        body.check(where)
        return body
    if isinstance(body, Plane):
        check_fields(body, robot, f"{where}.")
        if not any(body.normal):
            raise SceneError("its length is 0", where=f"{where}.normal", remedy="such as (0, 0, 1)")
        return body
    if not isinstance(body, str):
        raise SceneError(f"expected the name of a body, {GROUND!r}, a Plane or a HeightField, got {body!r:.60}",
                         where=where, remedy='such as ("foot", "ground")')  # fmt: skip
    if body == GROUND and not any(GROUND in kind for kind in named[:2]):
        return LEVEL
    found = next((kind[body] for kind in named if body in kind), [])
    if not found:
        names = dict.fromkeys((*named[0], *named[1], GROUND))
        check_name(body, names, where, "link with a collision shape")
    return found


def labels_of(solids: Sequence[Solid]) -> Labels:
    """The name in pairs of each solid, by its link and its own name; the parts of a mesh are one.

    It is that of the link, where the link has no other; else its own; with the link's before it where that is the name
    of something else too.
    """
    every = dict.fromkeys((solid.link, solid.name) for solid in solids)
    count, names = Counter(link for link, _ in every), Counter(name for _, name in every)
    return {(link, name): link if count[link] == 1 else name if names[name] == 1 and name not in count
            else f"{link} {name}" for link, name in every}  # fmt: skip


def _pair(labels: Labels, a: Solid, b: Solid | World) -> Pair:
    """The pair of two bodies, whose names are among the labels."""
    if isinstance(b, Solid) and _roundness(b) < _roundness(a):
        a, b = b, a

    def name(solid: Solid | World) -> str:
        if isinstance(solid, HeightField):
            return "field"
        if isinstance(solid, Plane):
            return GROUND if solid == LEVEL else "plane"
        return labels[solid.link, solid.name]

    return Pair(f"{name(a)} - {name(b)}", a, b)


def _body(robot: Robot, solid: Solid) -> int:
    """The number of the body that carries a solid; 0 is the ground."""
    return frame_pose(robot.model, solid.link)[0]


def _joints_between(model: pin.Model, a: int, b: int) -> list[int]:
    """The joints on the way from one body to another."""
    ways = [set(map(int, model.supports[j])) - {0} for j in (a, b)]
    return sorted(ways[0] ^ ways[1])


def _is_free(model: pin.Model, joint: int) -> bool:
    return bool(model.nvs[joint] >= 3 and model.joints[joint].shortname() != "JointModelSpherical")


def _roundness(solid: Solid) -> int:
    """0 for a sphere, 1 for a capsule, 2 for what has flat sides."""
    return {Sphere: 0, Capsule: 1}.get(type(solid.shape), 2)
