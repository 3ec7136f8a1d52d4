"""A scene with all that a robot's file says: gravity, damping, friction, stops, springs, loops; started within limits
and off equilibrium.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import frame_pose
from twolink.dynamics import Robot, load_robot
from twolink.effects import Effect, effect_class
from twolink.effects.constants import Gravity
from twolink.effects.contact import Contact
from twolink.effects.forces import FrameWrench, JointDamping, JointSpring
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.effects.loops import Coupling, Loop, PointLoop, WeldLoop
from twolink.errors import SceneError, require_known
from twolink.geometry.fields import HeightField
from twolink.geometry.pairs import Plane
from twolink.robots.catalogue import FILES, catalogue_entry, catalogue_names
from twolink.robots.collisions import collision_model
from twolink.robots.joint_layout import NO_LIMIT, JointLayout
from twolink.robots.load_report import Finding, LoadReport, findings
from twolink.robots.model import COMPENSATION
from twolink.robots.tree import Tree, read_tree
from twolink.robots.urdf import Ends, Mimic
from twolink.robots.xml import parse_xml
from twolink.scenes.file import bundled_scenes, load_scene
from twolink.scenes.scene import Scene

OFFSET = 0.5  # rad or m, from 0 at most: how far a joint is moved at the start
SHARE = 0.6  # of the range between its limits, towards which it is moved
STARTING_SPEED = 0.5  # rad/s or m/s, of a robot that would stay at rest
FRICTION = 0.8  # of bodies that touch: rubber on a floor
ABOVE = 1e-3  # m: how far the lowest point of a robot with a free base is above the ground at the start
FREE = (-np.inf, np.inf)
_GROUNDS: Mapping[str, type[Plane | HeightField]] = {"plane": Plane, "height-field": HeightField}
AT_REST = 1e-6  # N m, N: joint torques of gravity and friction below which a robot would


class UrdfScene(Scene):
    """A scene that `scene_of` made.

    Attributes
    ----------
    report : LoadReport
        What was taken from the file, what was not, and what was assumed.
    """

    @property
    def report(self) -> LoadReport:
        """The report of what was taken from the file, what was not, and what was assumed."""
        robot, model = self.base, self.base.model
        couplings = [one for one in self.effects if isinstance(one, Coupling)]
        limits, crowded = _limits(robot, _couplings(robot))
        stopped = [name for name, ends in limits.items() if np.isfinite(ends).any()]
        led = [joint.name for joint, ends in limited_joints(robot)
               if np.isfinite(ends).any() and joint.name not in (*limits, *crowded)]  # fmt: skip
        loops = [one for one in self.effects if isinstance(one, (PointLoop, WeldLoop))]
        springs = [one for one in self.effects if isinstance(one, JointSpring)]
        names = {
            "damping (JointDamping)": _joints(robot, model.damping),
            "friction (DryFriction, which holds joints at rest)": _joints(robot, model.friction),
            "limits of position (JointStops, without restitution)": stopped,
            "limits of joints that follow others (as JointStops of these)": led,
            "mimic joints (Coupling)": [one.joint for one in couplings],
            "loops (PointLoop, WeldLoop; rigid)": [f"{loop.a} to {loop.b}" for loop in loops],
            "springs (JointSpring)": [joint for spring in springs for joint in spring.stiffness],
            "gravity compensation (FrameWrench)": [one.frame for one in self.effects if isinstance(one, FrameWrench)],
        }
        effort = [name for name, limit in limits_by_joint(robot, model.upperEffortLimit).items() if limit > 0]
        ignored = {
            "limits of joints that follow others, which leave those no room": crowded,
            'limits of effort (no controller acts; controllers take effort="urdf")': effort,
            "limits of velocity (a result beyond them says so)": list(limits_by_joint(robot, model.velocityLimit)),
            "mimic (these joints move freely: a Coupling takes joints of one coordinate that are not locked; lock both "
            "at such positions, or give both limits)": _not_coupled(robot, couplings),
        }
        g = ", ".join(f"{x:g}" for x in robot.gravity)
        said = [one for one in robot.report.assumed if one.rule or "frees its base" in one.what]
        assumed = [
            *said,
            Finding("assumed", f"gravity ({g}) m/s^2"),
            Finding("assumed", f"a start of at most {OFFSET:g} rad or m from 0, within limits, or as an SRDF says"
                    if self._touches else f"a start of at most {OFFSET:g} rad or m from 0, within limits"),
            *findings("assumed", {f"a start with {STARTING_SPEED:g} rad/s or m/s, for gravity alone moves nothing": [
                name for name, moving in zip(robot.joint_names, [bool(self.v[j.v].any()) for j in robot.joints],
                                             strict=True) if moving]}),
            Finding("assumed", f"friction {FRICTION:g} of bodies that touch, no motor acts" if self._touches
                    else f"no body touches another{'' if robot.has_solids else ' (no shapes collide)'}, no motor acts"),
        ]  # fmt: skip
        taken = (*findings("read", names), *findings("ignored", ignored), *assumed)
        return LoadReport(robot.report.source, (*robot.report.suspicious, *taken))

    @property
    def _touches(self) -> bool:
        return any(isinstance(effect, Contact) for effect in self.effects)

    def __repr__(self) -> str:
        return f"{super().__repr__()}\n{self.report}"

    def __reduce__(self) -> tuple[Any, ...]:
        return UrdfScene, super().__reduce__()[1]


def scene_of(robot: Robot | str | os.PathLike[str], duration: float = 2.0, *, contact: bool = False) -> UrdfScene:
    """A scene with gravity and all that a robot's file says: damping, friction, stops, mimic joints; of an MJCF also
    springs, equality constraints (as rigid loops) and gravity compensation.

    It starts at rest, off equilibrium and within the limits, always the same. `print(scene)` says what was taken from
    the file, what was not, and what was assumed.

    Parameters
    ----------
    robot : Robot, str or path
        A robot, or what `load_robot` takes.
    duration : float
        Time to simulate, s.
    contact : bool
        Its links touch each other and the ground, or the planes and height fields of an MJCF, with their own collision
        shapes and a friction of 0.8; not where no link has such a shape. A robot of the catalogue that is meant to move
        about has a free base then, and starts just above the ground; one with an SRDF in its state "standing", else in
        the first.

    Returns
    -------
    UrdfScene
        A scene, with its report.

    Raises
    ------
    SceneError
        Nothing moves (code "nothing-moves").
    RobotError
        The robot is refused.
    """
    usual = catalogue_entry(robot).usual_root if contact and robot in catalogue_names() else "fixed"
    loaded = robot if isinstance(robot, Robot) else load_robot(robot, root=usual)
    if loaded.nv == 0:
        raise SceneError("no joint moves", where=f"robot {loaded.name!r}", argument="robot", code="nothing-moves",
                         remedy='free its base: root="free"')  # fmt: skip
    model, effects = loaded.model, list[Effect]([Gravity(tuple(loaded.gravity.tolist()))])
    couplings = _couplings(loaded)
    followers = [coupling.joint for coupling in couplings]
    if model.damping.any():
        effects.append(JointDamping())
    if model.friction.any():
        effects.append(DryFriction())
    limits = _limits(loaded, couplings)[0]
    stops = {name: ends for name, ends in limits.items() if np.isfinite(ends).any()}
    if stops:
        effects.append(JointStops(stops if followers else "urdf"))
    grounds = [_GROUNDS[kind](**given) for kind, given in loaded.visuals.laws.grounds]
    contact = contact and bool(loaded.solids)
    if contact:
        moved = dict.fromkeys(solid.link for solid in loaded.solids if frame_pose(model, solid.link)[0])
        pairs = [(link, one) for link in moved for one in grounds if one != Plane()]
        level = ["ground"] if not grounds or Plane() in grounds else []
        effects.append(Contact(("self", *level, *pairs), FRICTION))
    laws, q, starts = loaded.visuals.laws, loaded.neutral, {**loaded.visuals.laws.start, **loaded.visuals.placed}
    others = [effect for kind, given in laws.effects if (effect := _effect(loaded, kind, given))]
    states = loaded.visuals.srdf.states if contact else {}
    named = states.get("standing") or next(iter(states.values()), {})
    looped = any(isinstance(effect, Loop) for effect in others)
    for joint in loaded.joints:
        home = np.array(starts.get(joint.name, q[joint.q]))
        q[joint.q] = home if looped else _start(joint, home, limits.get(joint.name))
        if len(state := named.get(joint.name, ())) in (1, joint.q.stop - joint.q.start):
            q[joint.q] = joint.entries("q", state)
    entries = {joint.name: joint for joint in loaded.joints}
    for coupling in couplings:
        q[entries[coupling.joint].q] = coupling.ratio * q[entries[coupling.other].q] + coupling.offset
    effects += [*couplings, *others]
    if contact and loaded.root == "free":
        q[2] += ABOVE - _lowest(loaded, q)
    weight = np.concatenate([pin.computeGeneralizedGravity(tree.model, data, q[tree.q])
                             for tree, data in zip(loaded.trees, loaded.tree_data, strict=True)])  # fmt: skip
    still = np.all(np.abs(weight) <= np.maximum(model.friction, AT_REST))
    v = np.full(loaded.nv, STARTING_SPEED) if still else np.zeros(loaded.nv)
    for coupling in couplings:
        v[entries[coupling.joint].v] = coupling.ratio * v[entries[coupling.other].v]
    return UrdfScene(loaded, q, v, effects, duration, f"{loaded.name} under gravity, with all that its file says")


def named_scene(source: str) -> Scene:
    """A bundled scene or that of a file; of a robot, by its name or file, one with all that its file says.

    Raises SceneError, code "unknown-scene".
    """
    if not Path(source).suffix and os.sep not in source:
        require_known(source, (*bundled_scenes(), *catalogue_names()), SceneError,
                      "there is no bundled scene or robot {!r}", code="unknown-scene")  # fmt: skip
    return scene_of(source) if is_robot(source) else load_scene(source)


def is_robot(source: str) -> bool:
    """True if a name or file is of a robot, not of a scene."""
    return source.endswith(FILES) or (source in catalogue_names() and source not in bundled_scenes())


def _lowest(robot: Robot, q: np.ndarray) -> float:
    """The height of the lowest point of its collision shapes, m."""
    ground, shapes = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), collision_model(robot.model, robot.solids)
    data = pin.GeometryData(shapes)
    pin.updateGeometryPlacements(robot.model, robot.model.createData(), shapes, data, q)
    asked = coal.DistanceRequest(), coal.DistanceResult()
    return min(float(coal.distance(item.geometry, coal.Transform3s(at.rotation, at.translation), ground,
                                   coal.Transform3s(), *asked))
               for item, at in zip(shapes.geometryObjects, data.oMg, strict=True))  # fmt: skip


def urdf_tree(robot: Robot) -> Tree:
    """The tree of elements in the URDF of a robot."""
    return read_tree(parse_xml(robot.visuals.text.encode(), robot.report.source), robot.report.source)


def followers(robot: Robot, said: Tree) -> dict[str, Mimic]:
    """The joints that follow others by the robot's file, of which `said` is the URDF, each with its law."""
    coupled = {given["joint"]: Mimic(given["other"], given["ratio"], given["offset"])
               for kind, given in robot.visuals.laws.effects if kind == "coupling"}  # fmt: skip
    return {joint.name: joint.mimic for joint in said.moving if joint.mimic} | coupled


def _couplings(robot: Robot) -> list[Coupling]:
    """The joints that follow others by the URDF, but move freely in the robot: leaders before their followers."""
    ones = [joint.name for joint in robot.joints if joint.kind == "vector"]
    found = {joint.name: Coupling(joint.name, joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
             for joint in urdf_tree(robot).moving
             if joint.mimic and joint.name in ones and joint.mimic.joint in ones}  # fmt: skip

    def depth(name: str, seen: tuple[str, ...] = ()) -> int:
        return 0 if name not in found or name in seen else 1 + depth(found[name].other, (*seen, name))

    return sorted(found.values(), key=lambda coupling: depth(coupling.joint))


def _not_coupled(robot: Robot, couplings: Sequence[Coupling]) -> list[str]:
    """The joints that follow others by the file, but neither in the robot nor by couplings, each with its law."""
    coupled = {joint.name for joint in robot.joints if joint.kind == "mimic"} | {one.joint for one in couplings}
    laws = followers(robot, urdf_tree(robot)).items()
    return [f"{name} = {law.multiplier:g} {law.joint} + {law.offset:g}" for name, law in laws
            if name not in coupled and not {name, law.joint}.isdisjoint(robot.joint_names)]  # fmt: skip


def _effect(robot: Robot, kind: str, given: Mapping[str, Any]) -> Effect | None:
    """An effect of the robot's file; without joints that are locked."""
    if kind == "joint-spring":
        given = {name: {joint: x for joint, x in values.items() if joint in robot.joint_names}
                 for name, values in given.items()}  # fmt: skip
        if not given["stiffness"]:
            return None
    if kind == "coupling" and not {given["joint"], given["other"]} <= set(robot.joint_names):
        return None
    if kind == COMPENSATION:
        force = tuple((-given["mass"] * robot.gravity).tolist())
        return FrameWrench(given["frame"], force, point=given["point"])
    made: Effect = effect_class(kind)(**given)
    return made


def _limits(robot: Robot, couplings: Sequence[Coupling]) -> tuple[dict[str, Ends], list[str]]:
    """The limits of joints that follow no others, narrowed to those of their followers; those that leave no room."""
    limits, crowded = {joint.name: ends for joint, ends in limited_joints(robot)}, list[str]()
    for one in reversed(couplings):
        own, leader = limits.pop(one.joint), limits.get(one.other, FREE)
        ends = Mimic(one.other, one.ratio, one.offset).within(leader, own)
        crowded += [one.joint] * (ends is None)
        limits[one.other] = ends or leader
    return limits, crowded


def _start(joint: JointLayout, home: np.ndarray, limits: Ends | None) -> np.ndarray:
    """The configuration of a joint at the start, near the one that its file gives, or zero."""
    if joint.kind == "cos-sin":
        return joint.entries("q", OFFSET)
    if joint.kind != "vector":
        return home
    lower, upper = limits or (joint.lower[0], joint.upper[0])
    if not np.isfinite([lower, upper]).all():
        away = OFFSET if joint.unit == "rad" else 0.0
        return np.clip(home + away, lower, upper)
    zero = min(max(float(home[0]), lower), upper)
    aim = lower + SHARE * (upper - lower)
    return np.array([zero + min(max(aim - zero, -OFFSET), OFFSET)])


def limited_joints(robot: Robot) -> list[tuple[JointLayout, tuple[float, float]]]:
    """The joints with one coordinate, and their limits."""
    return [(joint, (joint.lower[0], joint.upper[0])) for joint in robot.joints if joint.kind == "vector"]


def limits_by_joint(robot: Robot, values: np.ndarray) -> dict[str, float]:
    """The finite limits that are not zero, by joint."""
    found = {joint.name: float(values[joint.v].max(initial=0.0)) for joint in robot.joints}
    return {name: limit for name, limit in found.items() if 0 < limit < NO_LIMIT}


def _joints(robot: Robot, values: Sequence[float] | np.ndarray) -> Iterable[str]:
    """The joints for which a value by degree of freedom is not zero."""
    return [joint.name for joint in robot.joints if np.any(np.asarray(values)[joint.v])]
