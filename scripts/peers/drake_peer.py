"""Drake: the same bodies and joints as the pin.Model in a continuous-time MultibodyPlant, and its integrators."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import numpy as np
import pinocchio as pin
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

from .problem import Accelerations, Answer, Contestant, Problem, RefusedError, Rung, axes

VERSION = version("drake")
SCHEMES = {"runge_kutta3": 1e-16, "runge_kutta5": 1e-16, "radau3": 1e-9}
"""Each with the smallest accuracy it is asked for: below it radau3's Newton iterations no longer converge, and it takes
minutes without an error."""


def build(model: pin.Model) -> Any:
    """The finished plant. Its positions are in the order of the joints: checked in `accelerations` by the values."""
    plant: Any = MultibodyPlant(time_step=0.0)
    plant.mutable_gravity_field().set_gravity_vector(model.gravity.linear)
    bodies = [plant.world_body()]
    axis: Any  # whose type pydrake states too narrowly
    for i, axis in enumerate(axes(model), start=1):
        name, at, inertia = model.names[i], model.jointPlacements[i], model.inertias[i]
        xx, xy, yy, xz, yz, zz = inertia.inertia[np.tril_indices(3)]
        about_centre = RotationalInertia(xx, yy, zz, xy, xz, yz)
        own = SpatialInertia.MakeFromCentralInertia(inertia.mass, inertia.lever, about_centre)
        body = plant.AddRigidBody(f"body of {name}", own)
        parent = bodies[model.parents[i]].body_frame()
        place = plant.AddFrame(FixedOffsetFrame(f"place of {name}", parent, RigidTransform(at.homogeneous)))
        plant.AddJoint(RevoluteJoint(name, place, body.body_frame(), axis, damping=0.0))
        bodies.append(body)
    plant.Finalize()
    return plant


def accelerations(problem: Problem) -> Accelerations:
    """The plant's time derivatives, for the check against pin.aba."""
    plant = build(problem.model)
    context = plant.CreateDefaultContext()

    def derivatives(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        return np.asarray(plant.EvalTimeDerivatives(context).CopyToVector())[problem.model.nv :]

    return derivatives


def contestants(problem: Problem, accuracies: list[float]) -> Iterator[Contestant]:
    """Error-controlled schemes, steps up to the interval between two common times."""
    plant = build(problem.model)
    simulator = Simulator(plant)
    for scheme, least in SCHEMES.items():
        yield Contestant(f"Drake {scheme}", [Rung(f"accuracy {a:.0e}", _run(problem, plant, simulator, scheme, a))
                                             for a in accuracies if a >= least])  # fmt: skip


def _run(problem: Problem, plant: Any, simulator: Any, scheme: str, accuracy: float) -> Callable[[], Answer]:
    context, later = simulator.get_mutable_context(), problem.times[1:].tolist()

    def run() -> Answer:
        integrator = ResetIntegratorFromFlags(simulator, scheme, problem.interval)  # 10 microseconds; it drops the last
        integrator.set_target_accuracy(accuracy)
        context.SetTime(0.0)
        plant.SetPositions(context, problem.scene.q)
        plant.SetVelocities(context, problem.scene.v)
        q = [problem.scene.q]
        try:
            simulator.Initialize()
            for t in later:
                simulator.AdvanceTo(t)
                q.append(plant.GetPositions(context).copy())
        except RuntimeError as error:
            raise RefusedError(str(error).split("\n")[0]) from None
        return Answer(np.array(q), integrator.get_num_derivative_evaluations())

    return run
