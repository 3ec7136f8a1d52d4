"""The setup of a measurement: what stands between a robot and its log, and is found by an outer loop where asked for.

    delay                torques in the log are late by it, s: tau(t) = log(t + delay)
    JOINT.zero           is added to the joint's measured position, rad or m
    gravity.tilt_x, _y   gravity's share along two axes across it (x and y where it points along z), rad
    JOINT.motor_constant torque by what was measured in its place, such as a current; starts from 1

The derivatives of the torques by these stand beside the columns of the regressor, so that Gauss-Newton's steps, the
covariance and what cannot be told come from the same linear least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.arguments import texts
from twolink.errors import QueryError, require_known
from twolink.parts.identification.base_parameters import regressor, single_joints
from twolink.parts.identification.drift import spans
from twolink.parts.identification.filtering import Recording
from twolink.parts.identification.measurements import Measurements

WORDS = {"delay": "delay", "zero": "*.zero", "gravity": "gravity.*", "motor_constant": "*.motor_constant"}


@dataclass(frozen=True)
class Setup:
    """Names (m,) of what is looked for of the setup, and their values (m,)."""

    robot: Robot
    names: tuple[str, ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def by_name(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def of_joints(self, kind: str, usual: float) -> np.ndarray:
        """The values (nv,) of a kind, the usual one where it is not looked for."""
        out = np.full(self.robot.nv, usual)
        for joint, dof in single_joints(self.robot).items():
            out[dof] = self.by_name.get(f"{joint}.{kind}", usual)
        return out

    def dof(self, name: str) -> int:
        """The degree of freedom that JOINT.zero and the like are of."""
        return single_joints(self.robot)[name.rpartition(".")[0]]

    @property
    def true_robot(self) -> Robot:
        """The robot in the gravity that was found."""
        tilt = [value for name, value in self.by_name.items() if name.startswith("gravity.")]
        if not any(tilt):
            return self.robot
        size, down, across = _gravity(self.robot)
        direction = down + np.asarray(tilt) @ across
        return self.robot.with_gravity(size * direction / np.linalg.norm(direction))

    def corrected(self, run: Recording) -> Recording:
        """A run as it would have been logged without delay, with right zeros, and with torques."""
        tau, delay = run.tau, self.delay
        if delay:
            tau = np.stack([np.interp(run.t + delay, run.t, x) for x in tau.T], axis=1)
        return replace(run, q=self.position(run.q), tau=tau * self.of_joints("motor_constant", 1.0))

    def position(self, q: np.ndarray) -> np.ndarray:
        """Positions with the zeros that were found."""
        zero = self.of_joints("zero", 0.0)
        if not zero.any():
            return q
        return self.robot.integrate(q, np.broadcast_to(zero, (*np.shape(q)[:-1], self.robot.nv)))

    @property
    def delay(self) -> float:
        """The delay of the torques, s."""
        return self.by_name.get("delay", 0.0)


def names_of(robot: Robot) -> tuple[str, ...]:
    """Names of all that can be looked for of a robot's setup."""
    single = single_joints(robot)
    zeros = () if robot.has_mimic else single  # Pinocchio has no derivatives where joints follow others
    tilt = ("gravity.tilt_x", "gravity.tilt_y") if np.any(robot.gravity) else ()
    return ("delay", *(f"{name}.zero" for name in zeros), *tilt, *(f"{name}.motor_constant" for name in single))


def setup_of(robot: Robot, find: Sequence[str]) -> Setup:
    """A setup whose words, names or patterns are looked for. Raises QueryError (code "unknown-parameter")."""
    known, names = names_of(robot), dict[str, None]()
    for text in texts(find, "find", QueryError, "such as 'delay' or ['zero', 'delay']"):
        fitting = [name for name in known if fnmatchcase(name, WORDS.get(text, text))]
        if not fitting:
            require_known(text, known, QueryError, "nothing of this robot's setup is called {!r}", argument="find",
                          code="unknown-parameter")  # fmt: skip
        names |= dict.fromkeys(fitting)
    return Setup(robot, tuple(names), np.array([float(name.endswith("constant")) for name in names]))


def derivatives(
    setup: Setup, parameters: np.ndarray, names: Sequence[str], data: Measurements, torques: np.ndarray
) -> np.ndarray:
    """(n, nv, m): of the model's torques less those measured by these names, at filtered samples.

    parameters (p,): of `robot.parameter_names`, as they are known by now, of bodies that need not exist. torques
    (n, nv): theirs, with those of the joint model.
    """
    robot, out = setup.true_robot, np.zeros((*torques.shape, len(names)))
    by_q, rest = None, np.zeros_like(data.v)
    for k, name in enumerate(names):
        if name == "delay":
            rates = [np.gradient(torques[rows], data.t[rows], axis=0) for rows in spans(data.ends)]
            out[..., k] = -np.concatenate(rates)
        elif name.startswith("gravity."):
            size, _, across = _gravity(robot)
            tilted = robot.with_gravity(size * across[int(name.endswith("y"))])
            out[..., k] = regressor(tilted, data.q, rest, rest, np.zeros(1)) @ parameters
        elif name.endswith(".zero"):
            by_q = _by_position(robot, parameters, data) if by_q is None else by_q
            out[..., k] = by_q[..., setup.dof(name)]
        else:
            dof = setup.dof(name)
            out[:, dof, k] = -torques[:, dof] / setup.of_joints("motor_constant", 1.0)[dof]
    return out


def _by_position(robot: Robot, parameters: np.ndarray, data: Measurements) -> np.ndarray:
    """d(Y pi)/dq (n, nv, nv), of bodies pi that need not exist nor have mass.

    It is linear in pi: that of pi with point masses at the joints, which make every mass positive, less that of these.
    Nothing is divided by an inertia, so that joints may move none.
    """
    bodies = parameters[: 10 * (robot.model.njoints - 1)].reshape(-1, 10)
    points = np.zeros_like(bodies)
    points[:, 0] = 1.0 + 2 * np.abs(bodies[:, 0])

    def of(values: np.ndarray) -> np.ndarray:
        def change(model: pin.Model) -> None:
            for j, body in enumerate(values, 1):
                model.inertias[j] = pin.Inertia.FromDynamicParameters(body)

        changed = robot.changed(change)
        changed.weightless = ()
        return changed.inverse_dynamics_derivatives(data.q, data.v, data.a, engine="pinocchio")[0]

    return np.asarray(of(bodies + points) - of(points))


def _gravity(robot: Robot) -> tuple[float, np.ndarray, np.ndarray]:
    """The size of gravity, its direction, and two unit vectors (2, 3) across it, of the world's axes the nearest."""
    size = float(np.linalg.norm(robot.gravity))
    down = robot.gravity / size
    axes = np.delete(np.eye(3), int(np.argmax(np.abs(down))), axis=0)
    first = axes[0] - (axes[0] @ down) * down
    first /= np.linalg.norm(first)
    second = np.cross(down, first)
    return size, down, np.stack([first, second * np.sign(second @ axes[1])])
