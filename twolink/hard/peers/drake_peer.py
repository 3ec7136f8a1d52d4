"""Drake: the bodies and joints of the pin.Model in a MultibodyPlant.

A tree is a continuous plant with Simulator's default integrator (runge_kutta3, accuracy 1e-3) and at a tight accuracy.
Loops need a discrete plant (ball constraints), at Drake's usual 1 ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteJoint,
    RevoluteSpring,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

from twolink.hard.case import Track
from twolink.hard.peers.problem import CannotError, Clock, JointSpec, Problem, SaidError, Way

TIGHT = 1e-10
STEP = 1e-3


def ways(problem: Problem) -> Iterator[Way]:
    """A continuous plant at the default and at a tight accuracy; with loops a discrete one."""
    if problem.torques:
        raise CannotError("torques in time are not built for Drake here")
    if problem.loops:
        yield Way("discrete plant (SAP), 1 ms, ball constraints", lambda: _solve(problem, None, STEP))
        yield Way("discrete plant (SAP), 0.1 ms, ball constraints", lambda: _solve(problem, None, STEP / 10))
        return
    _build(problem, 0.0)
    yield Way("Simulator default: runge_kutta3, accuracy 1e-3", lambda: _solve(problem, None, 0.0))
    yield Way(f"runge_kutta5, accuracy {TIGHT:.0e}", lambda: _solve(problem, TIGHT, 0.0))


def _build(problem: Problem, step: float) -> tuple[Any, list[Any]]:
    plant: Any = MultibodyPlant(time_step=step)
    plant.mutable_gravity_field().set_gravity_vector(problem.model.gravity.linear)
    bodies, joints = [plant.world_body()], []
    try:
        for joint in problem.joints:
            joints.append(_add(plant, bodies, joint, problem))
        for a, point_a, b, point_b in problem.loops:
            plant.AddBallConstraint(bodies[a], point_a, bodies[b], point_b)
        plant.Finalize()
    except (RuntimeError, ValueError) as error:
        raise SaidError(f"the model is refused: {' '.join(str(error).split())[:250]}") from None
    return plant, joints


def _add(plant: Any, bodies: list[Any], joint: JointSpec, problem: Problem) -> Any:
    inertia, name = joint.inertia, joint.name
    xx, xy, yy, xz, yz, zz = inertia.inertia[np.tril_indices(3)]
    own = SpatialInertia.MakeFromCentralInertia(
        inertia.mass, inertia.lever, RotationalInertia(xx, yy, zz, xy, xz, yz)
    )  # fmt: skip
    body = plant.AddRigidBody(f"body of {name}", own)
    parent = bodies[joint.parent].body_frame()
    bodies.append(body)
    if joint.kind == "free":
        return None
    place = plant.AddFrame(FixedOffsetFrame(f"place of {name}", parent, RigidTransform(joint.place.homogeneous)))
    damping = problem.damping.get(name, 0.0)
    prismatic = joint.kind == "prismatic"
    kind = PrismaticJoint if prismatic else RevoluteJoint
    axis: Any = joint.axis  # whose type pydrake states too narrowly
    made = plant.AddJoint(kind(name, place, body.body_frame(), axis, damping=damping))
    stiffness, rest = problem.stiffness.get(name, 0.0), problem.rest.get(name, 0.0)
    if stiffness:
        plant.AddForceElement((PrismaticSpring if prismatic else RevoluteSpring)(made, rest, stiffness))
    return made


def _solve(problem: Problem, accuracy: float | None, step: float) -> Track:
    plant, joints = _build(problem, step)
    simulator = Simulator(plant)
    context, clock = simulator.get_mutable_context(), Clock()
    if accuracy is not None:
        ResetIntegratorFromFlags(simulator, "runge_kutta5", 0.1)
        simulator.get_mutable_integrator().set_target_accuracy(accuracy)
    _start(problem, plant, context, joints)
    q, v = [problem.scene.q], [problem.scene.v]
    try:
        simulator.Initialize()
        for t in problem.times[1:].tolist():
            clock(t)
            simulator.set_monitor(_Watch(clock))
            simulator.AdvanceTo(t)
            now = _read(problem, plant, context, joints)
            q.append(now[0])
            v.append(now[1])
    except RuntimeError as error:
        raise SaidError(str(error).split("\n")[0]) from None
    return Track(problem.times, np.array(q), np.array(v))


class _Watch:
    """A monitor of Drake's that only looks at the clock."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock

    def __call__(self, context: Any) -> None:
        self.clock(context.get_time())


def _start(problem: Problem, plant: Any, context: Any, joints: list[Any]) -> None:
    for joint, made in zip(problem.joints, joints, strict=True):
        q, v = problem.scene.q[joint.q], problem.scene.v[joint.v]
        if joint.kind == "free":
            plant.SetPositions(context, [q[6], *q[3:6], *q[:3]])
            turn = pin.Quaternion(np.array(q[3:])).matrix()
            plant.SetVelocities(context, [*(turn @ v[3:]), *(turn @ v[:3])])
        elif joint.kind == "prismatic":
            made.set_translation(context, float(q[0]))
            made.set_translation_rate(context, float(v[0]))
        else:
            made.set_angle(context, float(np.arctan2(q[1], q[0]) if joint.kind == "continuous" else q[0]))
            made.set_angular_rate(context, float(v[0]))


def _read(problem: Problem, plant: Any, context: Any, joints: list[Any]) -> tuple[np.ndarray, np.ndarray]:
    q, v = np.empty(problem.model.nq), np.empty(problem.model.nv)
    for joint, made in zip(problem.joints, joints, strict=True):
        if joint.kind == "free":
            p, u = plant.GetPositions(context), plant.GetVelocities(context)
            q[joint.q] = [*p[4:], *(p[1:4] / np.linalg.norm(p[:4])), p[0] / np.linalg.norm(p[:4])]
            turn = pin.Quaternion(q[joint.q][3:]).matrix()
            v[joint.v] = [*(turn.T @ u[3:]), *(turn.T @ u[:3])]
            continue
        value = made.get_translation(context) if joint.kind == "prismatic" else made.get_angle(context)
        rate = made.get_translation_rate(context) if joint.kind == "prismatic" else made.get_angular_rate(context)
        q[joint.q] = [np.cos(value), np.sin(value)] if joint.kind == "continuous" else value
        v[joint.v] = rate
    return q, v
