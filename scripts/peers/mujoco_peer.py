"""MuJoCo: the same bodies and joints as the pin.Model, everything that is not smooth dynamics switched off."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

from .problem import INTERVALS, Accelerations, Answer, Contestant, Problem, RefusedError, Rung, axes

VERSION = mujoco.__version__
LEAST_MOMENT = 2e-15  # kg m^2: MuJoCo takes no inertia below 1e-15, and a thin rod's own axis has 0
STAGES = {"Euler": 1, "implicitfast": 1, "RK4": 4}
LONGEST = 0.1  # s, the first rung's step at most
MOST = 10_000_000  # steps in an interval; the budget ends a ladder long before
OFF = ("CONSTRAINT", "EQUALITY", "FRICTIONLOSS", "LIMIT", "CONTACT", "SPRING", "DAMPER", "EULERDAMP", "WARMSTART",
       "ACTUATION", "SENSOR")  # fmt: skip
Advance = Callable[[mujoco.MjModel, mujoco.MjData, int], None]


def build(model: pin.Model) -> mujoco.MjModel:
    """The model in MuJoCo: principal inertias are our own, so that nothing is rounded in a text, or balanced."""
    spec = mujoco.MjSpec()
    spec.compiler.autolimits = False
    spec.option.gravity = model.gravity.linear
    bodies = [spec.worldbody]
    for i, axis in enumerate(axes(model), start=1):
        inertia, at = model.inertias[i], model.jointPlacements[i]
        moments, principal = np.linalg.eigh(inertia.inertia)
        principal[:, 0] *= np.linalg.det(principal)  # a rotation, not a reflection
        body = bodies[model.parents[i]].add_body(
            name=model.names[i], pos=at.translation, quat=_quaternion(at.rotation), explicitinertial=True,
            mass=inertia.mass, ipos=inertia.lever, iquat=_quaternion(principal),
            inertia=np.maximum(moments, LEAST_MOMENT),
        )  # fmt: skip
        body.add_joint(name=model.names[i], type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        bodies.append(body)
    compiled = spec.compile()
    for name in OFF:
        compiled.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)
    return compiled


def accelerations(problem: Problem) -> Accelerations:
    """mj_forward, for the check against pin.aba."""
    model = build(problem.model)
    data = mujoco.MjData(model)

    def forward(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        return np.array(data.qacc)

    return forward


def contestants(problem: Problem, factor: float) -> Iterator[Contestant]:
    """Fixed steps that divide the interval between two common times, `factor` times as many from rung to rung."""
    first = int(np.ceil(problem.interval / LONGEST))
    most = int(np.log(MOST / first) / np.log(factor))
    steps = sorted({round(first * factor**k) for k in range(most)})
    mujoco.set_mju_user_warning(lambda _: None)  # a step that is too long would leave a log file where we stand
    for name in STAGES:
        model = build(problem.model)
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
        advance = _faster(problem, model)
        rungs = [
            Rung(f"step {problem.interval / n:.2e} s", _run(problem, model, advance, n, STAGES[name])) for n in steps
        ]
        yield Contestant(f"MuJoCo {name}", rungs)


def _run(problem: Problem, model: mujoco.MjModel, advance: Advance, steps: int, stages: int) -> Callable[[], Answer]:
    data, q = mujoco.MjData(model), np.empty((INTERVALS + 1, model.nv))

    def run() -> Answer:
        model.opt.timestep = problem.interval / steps
        _reset(problem, model, data)
        q[0] = data.qpos
        for k in range(1, INTERVALS + 1):
            advance(model, data, steps)
            q[k] = data.qpos
        if not abs(data.time - problem.duration) < 1e-6:  # MuJoCo starts again at 0 when a state is not finite
            raise RefusedError("unstable at this step")
        return Answer(q.copy(), INTERVALS * steps * stages)

    return run


def _faster(problem: Problem, model: mujoco.MjModel) -> Advance:
    """mj_step with nstep, or rollout where it clearly takes less for the same steps of this model."""
    data, medians = mujoco.MjData(model), []
    model.opt.timestep = 1e-5
    for advance in (_by_step, _by_rollout):
        seconds = []
        for _ in range(7):
            _reset(problem, model, data)
            start = time.perf_counter()
            advance(model, data, 2_000)
            seconds.append(time.perf_counter() - start)
        medians.append(statistics.median(seconds))
    return _by_rollout if medians[1] < 0.95 * medians[0] else _by_step


def _by_step(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> None:
    mujoco.mj_step(model, data, nstep=steps)


def _by_rollout(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> None:
    state = np.concatenate([[data.time], data.qpos, data.qvel])
    states, _ = mujoco.rollout.rollout([model], [data], state[None], nstep=steps, skip_checks=False)
    data.time, data.qpos[:], data.qvel[:] = states[0, -1, 0], *np.split(states[0, -1, 1:], 2)


def _reset(problem: Problem, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:] = problem.scene.q, problem.scene.v


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(w, x, y, z), MuJoCo's order."""
    return np.asarray(pin.Quaternion(rotation).coeffs())[[3, 0, 1, 2]]
