"""MuJoCo: the bodies and joints of the pin.Model; everything that the task does not use is switched off.

Springs, dampers, dry friction, stops and equality constraints are MuJoCo's own, with its default solver parameters.
Torques are applied once a step, as a controller does it. Contacts are pairs of geoms with default solver parameters and
elliptic cones, which the manual advises against slip. mj_step with `nstep` advances; mujoco.rollout took 2 to 20 %
longer.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from twolink.effects.inputs import SAME_TIME, value_at
from twolink.hard.peers.task import (
    PeerError,
    PeerJoint,
    PeerRun,
    PeerSolid,
    PeerTask,
    Setting,
    UnsupportedError,
    from_peer,
    peer_columns,
    to_peer,
)
from twolink.robots.collisions import Box, Capsule, Convex, Cylinder, Sphere

VERSION = mujoco.__version__
SOFTENS = frozenset({"friction", "stops", "couplings"})
SIMULATES = SOFTENS | {"springs", "damping", "torques", "loops", "contacts", "armature"}
DEFAULT_STEP, FINE_STEP = 0.002, 1e-4
LONGEST_STEP, MAX_STEPS = 0.1, 10_000_000  # s; steps in an interval
SMALLEST_MOMENT = 2e-15  # kg m^2: a thin rod's own axis has 0, and MuJoCo takes none below 1e-15
STAGES = {"Euler": 1, "implicitfast": 1, "RK4": 4}
INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")  # in the order of mjtIntegrator
KINDS = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "continuous": mujoco.mjtJoint.mjJNT_HINGE,
         "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}  # fmt: skip
Chain = list[PeerJoint]
WARNINGS = tuple(getattr(mujoco.mjtWarning, f"mjWARN_{name}") for name in ("BADQPOS", "BADQVEL", "BADQACC", "INERTIA"))


def usual_settings(task: PeerTask) -> list[Setting]:
    """The default (Euler, 2 ms, or what the robot's own file says), and RK4 at 0.1 ms."""
    method, step = INTEGRATORS[int(task.options.get("integrator", 0))], task.options.get("timestep", DEFAULT_STEP)
    words = f"{'options of its file' if task.options else 'default'}: {1e3 * step:g} ms"
    return [Setting(method, words, step=step, default=True),
            Setting("RK4", f"{FINE_STEP * 1e3:g} ms", step=FINE_STEP)]  # fmt: skip


def all_settings(task: PeerTask, coarse: bool) -> list[Setting]:
    """Steps that divide the interval between two times, each about a square root of two shorter, or half as long."""
    factor, first = 2.0 if coarse else 2**0.5, int(np.ceil(task.interval / LONGEST_STEP))
    count = int(np.log(MAX_STEPS / first) / np.log(factor))
    steps = [task.interval / n for n in sorted({round(first * factor**k) for k in range(count)})]
    return [Setting(method, f"step {step:.2e} s", step=step) for method in STAGES for step in steps]


def prepare(task: PeerTask, setting: Setting) -> Callable[[], PeerRun]:
    """The function that solves the task at the setting. Raises PeerError when MuJoCo refuses the model."""
    model = build(task)
    data, times, count = mujoco.MjData(model), task.times, len(task.times)
    per_interval = max(1, int(np.ceil(task.interval / setting.step * (1 - 1e-9))))
    model.opt.timestep = task.interval / per_interval
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{setting.method.upper()}")
    (q0, v0), (q_at, v_at) = to_peer(task, body_spin=True), columns(task, model)
    mujoco.set_mju_user_warning(lambda _: None)  # looked at below; unhandled they go to the terminal and to a file

    def run() -> PeerRun:
        mujoco.mj_resetData(model, data)
        data.qpos[q_at], data.qvel[v_at] = q0, v0
        q, v = np.empty((count, model.nq)), np.empty((count, model.nv))
        q[0], v[0] = data.qpos, data.qvel
        for k in range(1, count):
            _advance(task, model, data, v_at, float(times[k - 1]), per_interval)
            q[k], v[k] = data.qpos, data.qvel
        for kind in WARNINGS:  # MuJoCo starts again at 0 when a state is not finite
            if data.warning[kind].number:
                raise PeerError(mujoco.mju_warningText(kind, data.warning[kind].lastinfo))
        track = from_peer(task, q[:, q_at], v[:, v_at], body_spin=True)
        return PeerRun(track, (count - 1) * per_interval * STAGES.get(setting.method, 1))

    return run


def accelerations(task: PeerTask) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """a (nv,) of q and v by mj_forward; of a free body it is MuJoCo's, in other axes."""
    model = build(task)
    data, (q_at, v_at) = mujoco.MjData(model), columns(task, model)

    def forward(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        data.qpos[q_at], data.qvel[v_at] = to_peer(replace(task, q=q, v=v), body_spin=True)
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[v_at])

    return forward


def build(task: PeerTask) -> mujoco.MjModel:
    """The model. Inertias are made principal here, so that nothing is rounded in a text, or balanced.

    Raises UnsupportedError, or PeerError for a model that MuJoCo refuses.
    """
    task.require(SIMULATES)
    spec = mujoco.MjSpec()
    spec.compiler.autolimits, spec.compiler.degree = False, False
    spec.option.gravity = task.model.gravity.linear
    bodies, waiting, carriers = [spec.worldbody], dict[int, Chain](), _carriers(task)
    for number, joint in enumerate(task.joints, 1):
        chain = [*waiting.get(joint.parent, []), joint]
        if number in carriers:  # MuJoCo takes no body without mass: its joint is one more of the body that it carries
            waiting[number] = chain
            bodies.append(None)
        else:
            bodies.append(_add_body(task, bodies[chain[0].parent], chain))
    for k, (a, point_a, b, point_b) in enumerate(task.loops):
        bodies[a].add_site(name=f"a{k}", pos=point_a)
        bodies[b].add_site(name=f"b{k}", pos=point_b)
        spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=f"a{k}",
                          name2=f"b{k}")  # fmt: skip
    for k, (first, second, friction) in enumerate(task.contacts):
        for side, solid in zip("ab", (first, second), strict=True):
            _add_geom(spec, bodies[solid.body], f"{side}{k}", solid)
        spec.add_pair(geomname1=f"a{k}", geomname2=f"b{k}", condim=3, friction=[friction, friction, 0.0, 0.0, 0.0])
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for driven, other, ratio, offset in task.couplings:
        equality = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=driven,
                                     name2=other)  # fmt: skip
        equality.data[:5] = [offset, ratio, 0.0, 0.0, 0.0]
    try:
        model = spec.compile()
    except ValueError as error:
        raise PeerError(f"the model is refused: {' '.join(str(error).split())}") from None
    for name, value in task.options.items():
        setattr(model.opt, name, type(getattr(model.opt, name))(value))
    used = {"FRICTIONLOSS": task.friction, "LIMIT": task.stops, "CONTACT": task.contacts,
            "EQUALITY": task.loops or task.couplings}  # fmt: skip
    off = ["ACTUATION", "SENSOR", *(name for name, given in used.items() if not given)]
    off += [] if any(used.values()) else ["CONSTRAINT", "WARMSTART"]
    off += [] if task.springs else ["SPRING"]
    off += [] if task.damping else ["DAMPER", "EULERDAMP"]
    for name in off:
        model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)
    return model


def _carriers(task: PeerTask) -> set[int]:
    """The joints whose body has no mass and carries one other, and which nothing else holds on to."""
    carried = Counter(joint.parent for joint in task.joints if joint.kind != "free")
    held = {number for a, _, b, _ in task.loops for number in (a, b)}
    held |= {solid.body for pair in task.contacts for solid in pair[:2]}
    return {number for number, joint in enumerate(task.joints, 1)
            if joint.inertia.mass == 0 and joint.kind != "free" and carried[number] == 1} - held  # fmt: skip


def _add_body(task: PeerTask, parent: Any, chain: Chain) -> Any:
    """Add a body with the joints of a chain, the outermost first, whose other bodies have no mass."""
    joint, places = chain[-1], list(accumulate((one.place for one in chain), pin.SE3.__mul__))
    moments, principal = np.linalg.eigh(joint.inertia.inertia)
    principal[:, 0] *= np.linalg.det(principal)  # a rotation, not a reflection
    body = parent.add_body(
        name=f"body of {joint.name}", pos=places[-1].translation, quat=_quaternion(places[-1].rotation),
        explicitinertial=True, mass=joint.inertia.mass, ipos=joint.inertia.lever, iquat=_quaternion(principal),
        inertia=np.maximum(moments, SMALLEST_MOMENT),
    )  # fmt: skip
    if joint.kind == "free":
        if task.model.armature[joint.v].any():
            raise UnsupportedError("armature of a free joint is not modelled for MuJoCo")
        damping = [task.damping.get(joint.name, 0.0), 0.0, 0.0]
        body.add_joint(name=joint.name, type=mujoco.mjtJoint.mjJNT_FREE, damping=damping)
        return body
    for one, place in zip(chain, places, strict=True):
        _add_joint(task, body, one, places[-1].actInv(place))
    return body


def _add_joint(task: PeerTask, body: Any, joint: PeerJoint, place: pin.SE3) -> None:
    """Add a joint of one coordinate, at a place in the body's frame."""
    stiffness, rest = task.springs.get(joint.name, (0.0, 0.0))
    far = 1e10  # of no stop; a stop at one end needs a range
    body.add_joint(  # stiffness and damping are polynomials: the first coefficient is the linear one
        name=joint.name, type=KINDS[joint.kind], axis=place.rotation @ joint.axis, pos=place.translation,
        stiffness=[stiffness, 0.0, 0.0], springref=rest, damping=[task.damping.get(joint.name, 0.0), 0.0, 0.0],
        armature=task.model.armature[joint.v.start], frictionloss=task.friction.get(joint.name, 0.0),
        limited=joint.name in task.stops, range=np.clip(task.stops.get(joint.name, (0.0, 0.0)), -far, far),
    )  # fmt: skip


def _add_geom(spec: Any, body: Any, name: str, solid: PeerSolid) -> None:
    """A shape without mass that touches in pairs only."""
    mesh = ""
    match solid.shape:
        case None:
            kind, size = mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 1.0]
        case Sphere(radius=radius):
            kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0.0, 0.0]
        case Box(size=edges):
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, [edge / 2 for edge in edges]
        case Capsule(radius=radius, length=length):
            kind, size = mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, length / 2, 0.0]
        case Cylinder(radius=radius, length=length):
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, length / 2, 0.0]
        case Convex(vertices=vertices):
            kind, size, mesh = mujoco.mjtGeom.mjGEOM_MESH, [0.0, 0.0, 0.0], f"mesh {name}"
            spec.add_mesh(name=mesh, uservert=np.array(vertices).ravel())
        case _:
            raise UnsupportedError(f"{type(solid.shape).__name__} is not modelled for MuJoCo")
    body.add_geom(name=name, meshname=mesh, type=kind, size=size, pos=solid.place.translation, mass=0.0, contype=0,
                  conaffinity=0, quat=_quaternion(solid.place.rotation))  # fmt: skip


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(w, x, y, z), MuJoCo's order."""
    return np.asarray(pin.Quaternion(rotation).coeffs())[[3, 0, 1, 2]]


def columns(task: PeerTask, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """The entries of qpos and qvel in the order of the task's joints."""
    indices = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint.name) for joint in task.joints]
    return peer_columns(task, [(int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])) for i in indices])


def _advance(task: PeerTask, model: Any, data: Any, v_at: np.ndarray, t: float, steps: int) -> None:
    if not task.torques:
        mujoco.mj_step(model, data, nstep=steps)
        return
    for k in range(steps):
        for joint in task.joints:
            if joint.name in task.torques:
                now = (t + k * model.opt.timestep) * (1.0 + SAME_TIME)  # not before a knot by rounding
                data.qfrc_applied[v_at[joint.v]] = sum(value_at(one, now, np) for one in task.torques[joint.name])
        mujoco.mj_step(model, data)
