"""Drake: the bodies and joints of the pin.Model in a MultibodyPlant.

A tree is a continuous plant, solved by Simulator's integrators with error control. Loops (ball constraints) and
contacts (points; rigid but for regularisation) have a discrete plant, at Drake's usual 1 ms; contacts also a continuous
one, with springs at points, solved by CENIC, the convex integrator with error control (Kurtz, Castro 2025).
"""

import logging
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
from pydrake import geometry
from pydrake.math import RigidTransform
from pydrake.multibody import plant as multibody
from pydrake.multibody import tree
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder

from twolink.hard.peers.task import (
    PeerContact,
    PeerError,
    PeerJoint,
    PeerRun,
    PeerTask,
    Setting,
    UnsupportedError,
    from_peer,
    peer_columns,
    to_peer,
    tolerances,
)
from twolink.robots.collisions import Box, Capsule, Cylinder, Sphere

VERSION = version("drake")
SIMULATES, SOFTENS = frozenset({"springs", "damping", "loops", "contacts"}), frozenset[str]()
logging.getLogger("drake").setLevel(logging.ERROR)  # it warns that half spaces do not touch deformable bodies
TIGHT, STEP = 1e-10, 1e-3
MAX_STEP = 0.1  # s, Drake's default for integrators with error control
DISCRETE = "discrete plant (SAP)"
CENIC = "cenic"
STIFFNESS = 1e7  # N/m, of a point of contact for CENIC: 1e6 (Drake's own) to 1e8 have the same error within a factor 3
METHODS = {"runge_kutta3": 1e-16, "runge_kutta5": 1e-16, "radau3": 1e-9}
"""Each with the smallest accuracy it is asked for: below it radau3's Newton iterations no longer converge, and it takes
minutes without an error."""


def usual_settings(task: PeerTask) -> list[Setting]:
    """A continuous plant at the default and at a tight accuracy; with loops or contacts a discrete one at two steps."""
    if task.loops or task.contacts:
        discrete = [Setting(DISCRETE, f"{h * 1e3:g} ms", step=h, default=h == STEP) for h in (STEP, STEP / 10)]
        return discrete if task.loops else [*discrete, Setting(CENIC, "accuracy 1e-6", 1e-6, MAX_STEP)]
    return [Setting("runge_kutta3", "default: accuracy 1e-3", default=True),
            Setting("runge_kutta5", f"accuracy {TIGHT:.0e}", TIGHT, MAX_STEP)]  # fmt: skip


def all_settings(task: PeerTask, coarse: bool) -> list[Setting]:
    """Integrators with error control at falling accuracies."""
    return [Setting(method, f"accuracy {a:.0e}", a, task.interval) for method, smallest in METHODS.items()
            for a in tolerances(coarse) if a >= smallest]  # fmt: skip


def prepare(task: PeerTask, setting: Setting) -> Callable[[], PeerRun]:
    """The function that solves the task at the setting. Raises UnsupportedError, or PeerError for a refused model."""
    task.require(SIMULATES)
    discrete = setting.method == DISCRETE
    stiffness = STIFFNESS if setting.method == CENIC else None
    system, plant, q_at, v_at = _build(task, setting.step if discrete else 0.0, stiffness)
    simulator = Simulator(system)
    whole, later = simulator.get_mutable_context(), task.times[1:].tolist()
    context = plant.GetMyMutableContextFromRoot(whole)
    q0, v0 = np.empty(len(q_at)), np.empty(len(v_at))
    q0[q_at], v0[v_at] = to_peer(task, body_spin=False)

    def run() -> PeerRun:
        if setting.tolerance is not None:  # takes 10 microseconds, and drops the last run's integrator
            integrator = ResetIntegratorFromFlags(simulator, setting.method, setting.step)
            integrator.set_target_accuracy(setting.tolerance)
        whole.SetTime(0.0)
        plant.SetPositions(context, q0)
        plant.SetVelocities(context, v0)
        q, v = [q0], [v0]
        try:
            simulator.Initialize()
            for t in later:
                simulator.AdvanceTo(t)
                q.append(plant.GetPositions(context).copy())
                v.append(plant.GetVelocities(context).copy())
        except RuntimeError as error:
            raise PeerError(str(error).split("\n")[0]) from None
        evaluations = None if discrete else simulator.get_integrator().get_num_derivative_evaluations()
        return PeerRun(from_peer(task, np.array(q)[:, q_at], np.array(v)[:, v_at], body_spin=False), evaluations)

    return run


def accelerations(task: PeerTask) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """a (nv,) of q and v by the plant's time derivatives; of a free body it is Drake's, in other axes."""
    _, plant, q_at, v_at = _build(replace(task, contacts=()), 0.0)
    context, state = plant.CreateDefaultContext(), np.empty(len(q_at) + len(v_at))

    def derivatives(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        state[q_at], state[len(q) + v_at] = to_peer(replace(task, q=q, v=v), body_spin=False)
        plant.SetPositionsAndVelocities(context, state)
        rates: np.ndarray = plant.EvalTimeDerivatives(context).CopyToVector()
        return np.asarray(rates[len(q) + v_at])

    return derivatives


def _build(task: PeerTask, step: float, stiffness: float | None = None) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """The system, its finished plant, and the entries of its q and v in the order of the task's joints."""
    builder = DiagramBuilder()
    plant: Any = multibody.MultibodyPlant(time_step=step)
    if task.contacts:
        plant, _ = multibody.AddMultibodyPlantSceneGraph(builder, plant)
        plant.set_name("plant")  # as CENIC looks for it
    plant.mutable_gravity_field().set_gravity_vector(task.model.gravity.linear)
    bodies, joints = [plant.world_body()], []
    try:
        for joint in task.joints:
            joints.append(_add_joint(task, plant, bodies, joint))
        ends = [_anchor(plant), *bodies[1:]] if task.loops else []
        for a, point_a, b, point_b in task.loops:
            plant.AddBallConstraint(ends[a], point_a, ends[b], point_b)
        for k, contact in enumerate(task.contacts):
            _add_contact(plant, bodies, k, contact, stiffness)
        plant.Finalize()
    except (RuntimeError, ValueError) as error:
        raise PeerError(f"the model is refused: {' '.join(str(error).split())}") from None
    starts = [(joint.position_start(), joint.velocity_start()) for joint in joints]
    # Drake has the quaternion before the position, and the angular velocity first.
    system = builder.Build() if task.contacts else plant
    return system, plant, *peer_columns(task, starts, (4, 5, 6, 0, 1, 2, 3), (3, 4, 5, 0, 1, 2))


def _anchor(plant: Any) -> Any:
    """A body that is fixed to the world: Drake 1.51 crashes where a ball constraint holds the world itself."""
    anchor = plant.AddRigidBody("anchor", tree.SpatialInertia.SolidSphereWithMass(1.0, 1.0))
    plant.AddJoint(tree.WeldJoint("anchor", plant.world_frame(), anchor.body_frame(), RigidTransform()))
    return anchor


def _add_contact(plant: Any, bodies: list[Any], k: int, contact: PeerContact, stiffness: float | None) -> None:
    """Both shapes with the friction of the pair; Drake lets every two bodies touch that no joint connects.

    stiffness: of a point of contact, N/m; None: Drake's estimate.
    """
    *solids, friction = contact
    material = geometry.ProximityProperties()
    coulomb = multibody.CoulombFriction(friction, friction)
    geometry.AddContactMaterial(material, point_stiffness=stiffness, friction=coulomb)
    for side, solid in zip("ab", solids, strict=True):
        match solid.shape:
            case None:
                shape: Any = geometry.HalfSpace()
            case Sphere(radius=radius):
                shape = geometry.Sphere(radius)
            case Box(size=edges):
                shape = geometry.Box(*edges)
            case Capsule(radius=radius, length=length):
                shape = geometry.Capsule(radius, length)
            case Cylinder(radius=radius, length=length):
                shape = geometry.Cylinder(radius, length)
            case _:
                raise UnsupportedError(f"{type(solid.shape).__name__} is not modelled for Drake")
        place = RigidTransform(solid.place.homogeneous)
        plant.RegisterCollisionGeometry(bodies[solid.body], place, shape, f"{side}{k}", material)


def _add_joint(task: PeerTask, plant: Any, bodies: list[Any], joint: PeerJoint) -> Any:
    """Add the joint and the body behind it."""
    xx, xy, yy, xz, yz, zz = joint.inertia.inertia[np.tril_indices(3)]
    central = tree.RotationalInertia(xx, yy, zz, xy, xz, yz)
    inertia = tree.SpatialInertia.MakeFromCentralInertia(joint.inertia.mass, joint.inertia.lever, central)
    body = plant.AddRigidBody(f"body of {joint.name}", inertia)
    parent, place = bodies[joint.parent].body_frame(), RigidTransform(joint.place.homogeneous)
    bodies.append(body)
    base = plant.AddFrame(tree.FixedOffsetFrame(f"place of {joint.name}", parent, place))
    if joint.kind == "free":
        return plant.AddJoint(tree.QuaternionFloatingJoint(joint.name, base, body.body_frame()))
    prismatic = joint.kind == "prismatic"
    kind = tree.PrismaticJoint if prismatic else tree.RevoluteJoint
    axis: Any = joint.axis  # whose type pydrake states too narrowly
    damping = task.damping.get(joint.name, 0.0)
    made = plant.AddJoint(kind(joint.name, base, body.body_frame(), axis, damping=damping))
    stiffness, rest = task.springs.get(joint.name, (0.0, 0.0))
    if stiffness:
        plant.AddForceElement((tree.PrismaticSpring if prismatic else tree.RevoluteSpring)(made, rest, stiffness))
    return made
