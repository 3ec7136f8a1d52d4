"""MuJoCo: the bodies and joints of the pin.Model, at its default step and integrator, and at finer ones.

Contacts and joint limits are off; springs, dampers and equality constraints are MuJoCo's own, with its default solver
parameters. Torques are applied as a controller does, once a step.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from twolink.hard.case import Track
from twolink.hard.peers.problem import CannotError, Clock, JointSpec, Problem, SaidError, Way, value

DEFAULT_STEP = 0.002
FINE = ("RK4", 1e-4)
LEAST_MOMENT = 2e-15  # kg m^2: a thin rod's own axis has 0, and MuJoCo takes none below 1e-15
KINDS = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "continuous": mujoco.mjtJoint.mjJNT_HINGE,
         "prismatic": mujoco.mjtJoint.mjJNT_SLIDE, "free": mujoco.mjtJoint.mjJNT_FREE}  # fmt: skip
WARNED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC,
          mujoco.mjtWarning.mjWARN_INERTIA)  # fmt: skip


def ways(problem: Problem) -> Iterator[Way]:
    """The default (Euler, 2 ms), and RK4 at 0.1 ms."""
    model = build(problem)
    name, step = FINE
    yield Way("default: Euler, 2 ms", lambda: _solve(problem, model, DEFAULT_STEP, None))
    yield Way(f"{name}, {step * 1e3:g} ms", lambda: _solve(problem, model, step, name))


def build(problem: Problem) -> mujoco.MjModel:
    """The model. Raises SaidError when MuJoCo refuses it."""
    spec = mujoco.MjSpec()
    spec.compiler.autolimits = False
    spec.option.gravity = problem.model.gravity.linear
    bodies = [spec.worldbody]
    for joint in problem.joints:
        body = _add_body(bodies[joint.parent], joint)
        if joint.kind == "free":
            body.add_freejoint(name=joint.name)
        else:
            body.add_joint(
                name=joint.name, type=KINDS[joint.kind], axis=joint.axis,
                stiffness=_filled(problem.stiffness.get(joint.name, 0.0)),
                springref=problem.rest.get(joint.name, 0.0), damping=_filled(problem.damping.get(joint.name, 0.0)),
            )  # fmt: skip
        bodies.append(body)
    for a, point_a, b, point_b in problem.loops:
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=_site(bodies[a], point_a), name2=_site(bodies[b], point_b),
        )  # fmt: skip
    try:
        model = spec.compile()
    except ValueError as error:
        raise SaidError(f"the model is refused: {' '.join(str(error).split())}") from None
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


_sites = 0


def _site(body: Any, point: np.ndarray) -> str:
    global _sites
    _sites += 1
    body.add_site(name=f"site{_sites}", pos=point)
    return f"site{_sites}"


def _filled(number: float) -> np.ndarray:
    """Stiffness and damping may be polynomials in MuJoCo: the first coefficient is the linear one."""
    return np.array([number, 0.0, 0.0])


def _add_body(parent: Any, joint: JointSpec) -> Any:
    moments, principal = np.linalg.eigh(joint.inertia.inertia)
    principal[:, 0] *= np.linalg.det(principal)
    return parent.add_body(
        name=f"body of {joint.name}", pos=joint.place.translation, quat=_quaternion(joint.place.rotation),
        explicitinertial=True, mass=joint.inertia.mass, ipos=joint.inertia.lever, iquat=_quaternion(principal),
        inertia=np.maximum(moments, LEAST_MOMENT),
    )  # fmt: skip


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    return np.asarray(pin.Quaternion(rotation).coeffs())[[3, 0, 1, 2]]


def _solve(problem: Problem, model: mujoco.MjModel, step: float, integrator: str | None) -> Track:
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{(integrator or 'Euler').upper()}")
    data, clock, times = mujoco.MjData(model), Clock(), problem.times
    _start(problem, model, data)
    each = max(1, int(np.ceil((times[1] - times[0]) / step * (1 - 1e-9))))
    model.opt.timestep = (times[1] - times[0]) / each
    q, v = [problem.scene.q], [problem.scene.v]
    mujoco.set_mju_user_warning(lambda _: None)  # counted below; unhandled it goes to the terminal and to a file
    for t in times[:-1]:
        _advance(problem, model, data, float(t), each, clock)
        q.append(_configuration(problem, data))
        v.append(_velocity(problem, data))
        for kind in WARNED:
            if data.warning[kind].number:
                raise SaidError(mujoco.mju_warningText(kind, data.warning[kind].lastinfo))
    return Track(times, np.array(q), np.array(v))


def _advance(problem: Problem, model: Any, data: Any, t: float, steps: int, clock: Clock) -> None:
    chunk = 1 if problem.torques else min(steps, 20_000)
    done = 0
    while done < steps:
        clock(t)
        for joint in problem.joints:
            if joint.name in problem.torques:
                data.qfrc_applied[joint.v] = value(problem.torques[joint.name], t + done * model.opt.timestep)
        now = min(chunk, steps - done)
        mujoco.mj_step(model, data, nstep=now)
        done += now


def _start(problem: Problem, model: Any, data: Any) -> None:
    mujoco.mj_resetData(model, data)
    for joint, index in zip(problem.joints, range(model.njnt), strict=True):
        at, dof = model.jnt_qposadr[index], model.jnt_dofadr[index]
        q, v = problem.scene.q[joint.q], problem.scene.v[joint.v]
        if joint.kind == "free":
            data.qpos[at : at + 7] = [*q[:3], q[6], *q[3:6]]
            turn = pin.Quaternion(np.array(q[3:])).matrix()
            data.qvel[dof : dof + 6] = [*(turn @ v[:3]), *v[3:]]
        else:
            data.qpos[at] = np.arctan2(q[1], q[0]) if joint.kind == "continuous" else q[0]
            data.qvel[dof] = v[0]


def _configuration(problem: Problem, data: Any) -> np.ndarray:
    out, at = np.empty(problem.model.nq), 0
    for joint in problem.joints:
        if joint.kind == "free":
            p = data.qpos[at : at + 7]
            out[joint.q] = [*p[:3], *p[4:], p[3]]
        elif joint.kind == "continuous":
            out[joint.q] = [np.cos(data.qpos[at]), np.sin(data.qpos[at])]
        else:
            out[joint.q] = data.qpos[at]
        at += 7 if joint.kind == "free" else 1
    return out


def _velocity(problem: Problem, data: Any) -> np.ndarray:
    out, at, place = np.empty(problem.model.nv), 0, 0
    for joint in problem.joints:
        if joint.kind == "free":
            w, x, y, z = data.qpos[place + 3 : place + 7]
            turn = pin.Quaternion(w, x, y, z).matrix()
            out[joint.v] = [*(turn.T @ data.qvel[at : at + 3]), *data.qvel[at + 3 : at + 6]]
        else:
            out[joint.v] = data.qvel[at]
        at += 6 if joint.kind == "free" else 1
        place += 7 if joint.kind == "free" else 1
    return out


__all__ = ["CannotError", "build", "ways"]
