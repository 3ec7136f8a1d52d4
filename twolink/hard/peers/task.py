"""The task, setting and result of a peer; its run in a process of its own, which is ended
when it takes too long; and the coordinates that MuJoCo and Drake share.
"""

import multiprocessing
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from twolink import effects as fx
from twolink.algorithms.joint_models import read_joint
from twolink.algorithms.spatial import across, unit
from twolink.dynamics import Robot
from twolink.geometry.pairs import Plane
from twolink.hard.case import StateHistory
from twolink.robots.collisions import AnyShape, Solid
from twolink.scenes import Scene

Loop = tuple[int, np.ndarray, int, np.ndarray]
"""(body, point (3,), body, point (3,)): points held together, in the frames of the bodies' joints; 0 is the ground."""
MAX_SECONDS = 10.0


class UnsupportedError(Exception):
    """The peer lacks a feature that the task needs, or it is not modelled here."""


class PeerError(Exception):
    """The peer itself reports that something is wrong."""


@dataclass(frozen=True)
class Setting:
    """The setting of a peer's run.

    Parameters
    ----------
    method : str
        The peer's name of the method.
    words : str
        Tolerance or step as text.
    tolerance : float, optional
        Relative and absolute tolerance of a step; None leaves the peer's default.
    step : float
        Length of a step, s; with a tolerance the longest one; 0 leaves the peer's default.
    default : bool
        Whether this is what the peer does when nothing is set.
    """

    method: str
    words: str
    tolerance: float | None = None
    step: float = 0.0
    default: bool = False

    def __str__(self) -> str:
        return f"{self.method}, {self.words}"


@dataclass(frozen=True)
class PeerRun:
    """States at the task's times, and the number of evaluations of the dynamics where the peer counts them."""

    track: StateHistory
    evaluations: int | None = None


@dataclass(frozen=True)
class PeerJoint:
    """A joint of the model: "revolute", "prismatic", "continuous" or "free", with its axis in its own frame.

    parent: number of the parent's joint, 0 for the ground. place: of the joint's frame in the parent's. inertia: of the
    body behind it. q, v: its entries in Pinocchio's q and v.
    """

    name: str
    kind: str
    parent: int
    place: pin.SE3
    axis: np.ndarray
    inertia: pin.Inertia
    q: slice
    v: slice


@dataclass(frozen=True)
class PeerSolid:
    """A shape of the body of a joint, 0 for the ground, placed in the joint's frame; None: the half space z <= 0."""

    body: int
    place: pin.SE3
    shape: AnyShape | None


PeerContact = tuple[PeerSolid, PeerSolid, float]
"""Two shapes that may touch, without restitution, and their friction."""


@dataclass(frozen=True)
class PeerTask:
    """A robot under gravity that is solved from (q, v) for the `times` (n,) [s], equally spaced from 0.

    springs: (stiffness, rest position) by joint. damping: by joint, of
    all its degrees of freedom. torques: inputs in time by joint, which add up. friction: dry, by
    joint. stops: (lower, upper) by joint. couplings: (joint, other, ratio, offset). options: of MuJoCo, by the robot's
    own file. SI units.
    """

    robot: Robot
    q: np.ndarray
    v: np.ndarray
    times: np.ndarray
    joints: tuple[PeerJoint, ...]
    springs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    torques: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    loops: tuple[Loop, ...] = ()
    contacts: tuple[PeerContact, ...] = ()
    friction: Mapping[str, float] = field(default_factory=dict)
    stops: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    couplings: tuple[tuple[str, str, float, float], ...] = ()
    options: Mapping[str, float] = field(default_factory=dict)

    @property
    def needs(self) -> set[str]:
        """Needs of a task, beside bodies, joints and gravity: the fields that are not empty, and armature.

        A field that is added is needed by default.
        """
        plain = ("robot", "q", "v", "times", "joints", "options")
        used = {one.name for one in fields(self) if one.name not in plain and getattr(self, one.name)}
        return used | ({"armature"} if self.model.armature.any() else set())

    def require(self, simulates: Collection[str]) -> None:
        """Raise UnsupportedError, which names what the task needs and the peer does not simulate."""
        lacking = sorted(_WORDS.get(need, need) for need in self.needs - set(simulates))
        if lacking:
            raise UnsupportedError(f"it does not simulate {', '.join(lacking)}")

    @property
    def model(self) -> pin.Model:
        """Pinocchio's model, gravity included."""
        return self.robot.model

    @property
    def interval(self) -> float:
        """Seconds between two times."""
        return float(self.times[1] - self.times[0])


_WORDS = {"friction": "dry friction", "torques": "torques in time"}


def task_of(scene: Scene, times: np.ndarray) -> PeerTask:
    """The task of a scene. Raises UnsupportedError for effects and joints that are not modelled for any peer."""
    springs: dict[str, tuple[float, float]] = {}
    damping: dict[str, float] = {}
    torques: dict[str, tuple[Any, ...]] = {}
    loops: list[Loop] = []
    contacts: list[PeerContact] = []
    softened: list[Any] = []
    for effect in scene.effects:
        if isinstance(effect, fx.JointSpring):
            for name, k in effect.stiffness.items():  # several springs are one
                before, rest = springs.get(name, (0.0, 0.0))
                moment = before * rest + k * float(effect.rest.get(name, 0.0))
                springs[name] = before + k, moment / ((before + k) or 1.0)
        elif isinstance(effect, fx.JointDamping):
            damping |= {name: damping.get(name, 0.0) + d for name, d in effect.viscosity(scene.robot).items()}
        elif isinstance(effect, fx.Torque):
            torques |= {name: (*torques.get(name, ()), one) for name, one in effect.inputs.items()}
        elif isinstance(effect, fx.PointLoop | fx.HingeLoop):
            loops += _point_pairs(scene.robot, effect)
        elif isinstance(effect, fx.Contact):
            contacts += _contacts(scene.robot, effect)
        elif isinstance(effect, fx.PlaneContact) and effect.radius > 0.0:
            plane, shape = fx.Plane(effect.normal, effect.height), fx.Sphere(effect.radius, effect.point)
            ball = fx.Contact(((effect.frame, plane),), effect.friction, effect.restitution,
                              shapes={effect.frame: (shape,)})  # fmt: skip
            contacts += _contacts(scene.robot, ball)
        elif isinstance(effect, fx.DryFriction | fx.JointStops | fx.Coupling):
            softened.append(effect)
        elif not isinstance(effect, fx.Gravity):
            raise UnsupportedError(f"{type(effect).__name__} is not modelled for peers")
    joints = _joints(scene.robot)
    return PeerTask(scene.robot, scene.q, scene.v, times, joints, springs, damping, torques, tuple(loops),
                    tuple(contacts), options=scene.base.visuals.laws.options,
                    **_softened(scene.robot, softened))  # fmt: skip


def _softened(robot: Robot, effects: Sequence[Any]) -> dict[str, Any]:
    """The fields friction, stops and couplings of a task. Raises UnsupportedError for what MuJoCo has not."""
    names, couplings = {j.v.start: j.name for j in robot.joints}, []
    friction, stops = dict[str, float](), dict[str, tuple[float, float]]()
    for effect in effects:
        if isinstance(effect, fx.Coupling):
            couplings.append((effect.joint, effect.other, effect.ratio, effect.offset))
        elif isinstance(effect, fx.DryFriction):
            for hold in effect.modes(robot):
                name = names[hold.dof]
                if hold.greatest > hold.kinetic:
                    raise UnsupportedError("static friction above the kinetic one is not modelled for peers")
                friction[name] = friction.get(name, 0.0) + hold.kinetic
        elif effect.restitution:
            raise UnsupportedError("stops with restitution are not modelled for peers")
        else:
            for stop in effect.modes(robot):
                lower, upper = stops.get(stop.name, (-np.inf, np.inf))
                nearer = (max(lower, stop.position), upper) if stop.side > 0 else (lower, min(upper, stop.position))
                stops[stop.name] = nearer
    return {"friction": friction, "stops": stops, "couplings": tuple(couplings)}


def _point_pairs(robot: Robot, effect: Any) -> list[Loop]:
    """A ball joint is a pair of points; a hinge is two pairs, half a metre apart on its axis."""
    (body_a, at_a), (body_b, at_b) = _carrier(robot, effect.a), _carrier(robot, effect.b)
    a, b = at_a.act(np.array(effect.point_a)), at_b.act(np.array(effect.point_b))
    pairs: list[Loop] = [(body_a, a, body_b, b)]
    if isinstance(effect, fx.HingeLoop):
        along_a = at_a.rotation @ np.array(effect.axis_a) / np.linalg.norm(effect.axis_a) / 2
        along_b = at_b.rotation @ np.array(effect.axis_b) / np.linalg.norm(effect.axis_b) / 2
        pairs.append((body_a, a + along_a, body_b, b + along_b))
    return pairs


def _contacts(robot: Robot, effect: fx.Contact) -> list[PeerContact]:
    """The pairs that may touch. Raises UnsupportedError for restitution and meshes, which peers model otherwise."""
    if effect.restitution or effect.static is not None:
        raise UnsupportedError("restitution and static friction are not modelled for peers")

    def solid(body: Solid | Plane | fx.HeightField) -> PeerSolid:
        if isinstance(body, fx.HeightField):
            raise UnsupportedError("height fields are not modelled for peers")
        if isinstance(body, Plane):
            n = unit(body.normal, "pairs")
            turn = np.array([*across(n), n]).T
            turn[:, 1] *= np.linalg.det(turn)
            return PeerSolid(0, pin.SE3(turn, float(body.height) * np.array(n)), None)
        number, place = _carrier(robot, body.link)
        return PeerSolid(number, place * body.shape.placement, body.shape)

    return [(solid(pair.first), solid(pair.second), float(effect.friction)) for pair in effect.selected(robot).chosen]


def _carrier(robot: Robot, link: str) -> tuple[int, pin.SE3]:
    """The joint that carries a link, and the link's place in its frame."""
    if link == "universe":
        return 0, pin.SE3.Identity()
    frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement


def _joints(robot: Robot) -> tuple[PeerJoint, ...]:
    model, out = robot.model, []
    for i, layout in enumerate(robot.joints, 1):
        if layout.kind in ("mimic", "planar", "quaternion"):
            raise UnsupportedError(f"{model.joints[i].shortname()} is not modelled for peers")
        joint = read_joint(model, i)
        kind = "free" if joint.kind == "free-flyer" else joint.kind
        out.append(PeerJoint(model.names[i], kind, int(model.parents[i]), model.jointPlacements[i],
                             np.array(joint.axis), model.inertias[i], layout.q, layout.v))  # fmt: skip
    return tuple(out)


def tolerances(coarse: bool) -> list[float]:
    """Tolerances from 0.1 to 1e-16, half a decade apart, or two decades."""
    return [10 ** (-k / 2) for k in range(2, 33, 4 if coarse else 1)]


def run_limited(run: Callable[[], PeerRun]) -> tuple[PeerRun, str]:
    """The run's answer and its first warning, or "".

    Raises
    ------
    UnsupportedError
        After MAX_SECONDS, or as the run raises it.
    PeerError
        As the run raises it, for any other exception of the run, and when its process crashes.
    """
    context = multiprocessing.get_context("fork")  # the run is a closure, and its model is built already
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(run, sender), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads do not survive a fork: the child uses none of them
        process.start()
    sender.close()
    try:
        if not receiver.poll(MAX_SECONDS):
            raise UnsupportedError(f"not at the end after {MAX_SECONDS:g} s")
        answer, message = receiver.recv()
    except EOFError:
        raise PeerError("its process ended with a crash") from None
    finally:
        process.kill()
        process.join()
    if isinstance(answer, PeerRun):
        return answer, message
    raise answer(message)


def _child(run: Callable[[], PeerRun], pipe: Any) -> None:
    try:
        with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
            warnings.simplefilter("always")
            answer = run()
        pipe.send((answer, str(caught[0].message) if caught else ""))
    except Exception as error:
        pipe.send((UnsupportedError if isinstance(error, UnsupportedError) else PeerError, str(error)))


def to_peer(task: PeerTask, *, body_spin: bool) -> tuple[np.ndarray, np.ndarray]:
    """The initial state in the coordinates that peers share, joint by joint.

    One number for a joint of one degree of freedom. For a free body position and quaternion (w, x, y, z); velocity,
    then angular velocity, in the world's axes. body_spin: the angular velocity is in the body's axes.
    """
    q: list[float] = []
    for joint in task.joints:
        x = task.q[joint.q]
        q += {"free": [*x[:3], *x[-1:], *x[3:-1]], "continuous": [np.arctan2(x[-1], x[0])]}.get(joint.kind, [*x])
    return np.array(q), _turned(task, task.q[None], task.v[None], body_spin, inverse=False)[0]


def from_peer(task: PeerTask, q: np.ndarray, v: np.ndarray, *, body_spin: bool) -> StateHistory:
    """Pinocchio's q (n, nq) and v (n, nv) of rows in the coordinates of `to_peer`."""
    out, at = np.empty((len(q), task.model.nq)), 0
    for joint in task.joints:
        if joint.kind == "free":
            quaternion = q[:, at + 3 : at + 7] / np.linalg.norm(q[:, at + 3 : at + 7], axis=1, keepdims=True)
            out[:, joint.q] = np.hstack([q[:, at : at + 3], quaternion[:, 1:], quaternion[:, :1]])
            at += 6
        elif joint.kind == "continuous":
            out[:, joint.q] = np.stack([np.cos(q[:, at]), np.sin(q[:, at])], axis=1)
        else:
            out[:, joint.q.start] = q[:, at]
        at += 1
    return StateHistory(task.times, out, _turned(task, out, v, body_spin, inverse=True))


def _turned(task: PeerTask, q: np.ndarray, v: np.ndarray, body_spin: bool, *, inverse: bool) -> np.ndarray:
    """Velocities of free bodies from the body's axes to the world's, or back; v has one layout everywhere."""
    for joint in task.joints:
        if joint.kind == "free":
            v, at = v.copy(), joint.v.start
            turn = Rotation.from_quat(q[:, joint.q][:, 3:])
            for part in (slice(at, at + 3), slice(at + 3, at + 6))[: 1 if body_spin else 2]:
                v[:, part] = turn.apply(v[:, part], inverse=inverse)
    return v


def peer_columns(
    task: PeerTask,
    starts: Iterable[tuple[int, int]],
    free_q: Sequence[int] = range(7),
    free_v: Sequence[int] = range(6),
) -> tuple[np.ndarray, np.ndarray]:
    """The entries of a peer's q and v in the order of `to_peer`.

    starts: where each joint's entries begin in q and in v. free_q, free_v: the order of a free body's entries.
    """
    q: list[int] = []
    v: list[int] = []
    for joint, (q_start, v_start) in zip(task.joints, starts, strict=True):
        q += [q_start + k for k in (free_q if joint.kind == "free" else (0,))]
        v += [v_start + k for k in (free_v if joint.kind == "free" else (0,))]
    return np.array(q), np.array(v)
