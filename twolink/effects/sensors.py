"""Sensors: what a robot's own instruments would read of its motion, with their rates, delays and errors."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects.checks import check_subset
from twolink.effects.contact import Contact
from twolink.effects.effect import Effect, JointName, LinkName, NotNegative, SingleJoint
from twolink.effects.loops import HingeLoop, PointLoop, WeldLoop
from twolink.effects.plane_contact import PlaneContact
from twolink.effects.sampled_control import check_clock
from twolink.errors import SceneError, shown
from twolink.io.text import kebab_case

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Forces:
    """Of n states: accelerations and joint torques of effects (n, nv), and by state the external wrenches by body.

    robots: by state, with the constants that hold in its mode: what is released, such as a payload, changes them.
    on (link) -> (n, 3): the contact forces on a link along the world's axes, N.
    """

    robots: Sequence[Robot]
    a: Array
    tau: Array
    wrenches: Sequence[Sequence[pin.Force]]
    on: Callable[[str], Array]


class Seen:
    """The input of sensors: states of a robot, q (n, nq) and v (n, nv), and of effects, by name z (n,); and forces.

    robot: its joints and links; its constants are those of `forces.robots`. look: computes the forces when they are
    needed.
    """

    def __init__(self, robot: Robot, q: Array, v: Array, z: Mapping[str, Array], look: Callable[[], Forces]) -> None:
        self.robot, self.q, self.v, self.z, self._look = robot, q, v, z, look

    @functools.cached_property
    def forces(self) -> Forces:
        """Accelerations and forces."""
        return self._look()

    def by_pinocchio(self, of: Callable[[pin.Model, pin.Data, int], Array]) -> Array:
        """(n, m): `of` each state, after the recursive Newton-Euler algorithm with its accelerations and wrenches."""
        forces, rows = self.forces, []
        memory = {robot: robot.model.createData() for robot in forces.robots}
        for i, (robot, q, v, a) in enumerate(zip(forces.robots, self.q, self.v, forces.a, strict=True)):
            model, data = robot.model, memory[robot]
            pin.rnea(model, data, q, v, a, list(forces.wrenches[i]))
            pin.forwardKinematics(model, data, q, v, a)
            rows.append(of(model, data, i))
        return np.array(rows)


class Sensor(Effect, frozen=True, kw_only=True):
    """A sensor: it is read at offset + k period, and its reading arrives `delay` later.

        reading = quantum round((value + bias + noise n_k + walk sqrt(period) (n'_1 + ... + n'_k)) / quantum)

    Parameters
    ----------
    name : str
        In y of controllers and in run.sensors; by default that of the class, such as "torque_sensor".
    period, offset, delay : float or Fraction
        s. Ticks are exact: 0.001 is 1/1000, 1 / 240 is 1/240.
    noise : float
        Standard deviation of the white noise n_k, in the unit of the value.
    walk : float
        Of the random walk of the bias in a second, that unit / sqrt(s).
    bias : float
        That unit.
    quantum : float
        Resolution; 0: none. Of an encoder with n counts a turn 2 pi / n.
    seed : int
        Of the noise: the same for the same seed, name and tick.
    """

    is_sensor: ClassVar[bool] = True
    of_forces: ClassVar[bool] = False  # whether it needs the forces at an instant, which steps of contacts have not

    name: str = ""
    period: NotNegative = 1e-3
    offset: NotNegative = 0.0
    delay: NotNegative = 0.0
    noise: NotNegative = 0.0
    walk: NotNegative = 0.0
    bias: float = 0.0
    quantum: NotNegative = 0.0
    seed: int = 0

    def __init_subclass__(cls, **options: Any) -> None:
        """Describe the fields that all have behind those of the class."""
        super().__init_subclass__(**options)
        shared = (Sensor.__doc__ or "").partition("----------\n")[2].rstrip()
        cls.__doc__ = f"{(cls.__doc__ or '').rstrip()}\n{shared}\n"

    @property
    def label(self) -> str:
        """Its name."""
        return self.name or kebab_case(type(self).__name__).replace("-", "_")

    def check(self, robot: Robot) -> None:
        """Require times, and a name."""
        del robot
        check_clock(self.period, {"offset": self.offset, "delay": self.delay}, self.seed)
        if not isinstance(self.label, str) or not self.label.isidentifier() or self.label in ("q", "v"):
            raise SceneError(
                f"{shown(self.label)} cannot name a sensor", where="name", remedy='a word such as "encoder"'
            )

    def read(self, seen: Seen) -> Array:
        """The true values (n, m)."""
        raise NotImplementedError


class _OfJoints(Sensor, frozen=True):
    """A sensor of joints.

    Parameters
    ----------
    joints : tuple of str
        Joints with one degree of freedom, in the order of the values.
    """

    joints: tuple[SingleJoint, ...]

    def dofs(self, robot: Robot) -> list[int]:
        """Their degrees of freedom."""
        return [robot.model.idx_vs[robot.model.getJointId(joint)] for joint in self.joints]


class Encoder(_OfJoints, frozen=True):
    """Joint encoders: positions, rad or m; of a continuous joint the angle from -pi to pi.

    Parameters
    ----------
    joints : tuple of str
        Joints with one degree of freedom, in the order of the values.
    """

    def read(self, seen: Seen) -> Array:
        """The positions (n, m)."""
        columns, model = [], seen.robot.model
        for joint in self.joints:
            i = model.getJointId(joint)
            q = seen.q[:, model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
            columns.append(q[:, 0] if q.shape[1] == 1 else np.arctan2(q[:, 1], q[:, 0]))
        return np.stack(columns, axis=1)


class Tachometer(_OfJoints, frozen=True):
    """Velocities of joints, rad/s or m/s.

    Parameters
    ----------
    joints : tuple of str
        Joints with one degree of freedom, in the order of the values.
    """

    def read(self, seen: Seen) -> Array:
        """The velocities (n, m)."""
        return seen.v[:, self.dofs(seen.robot)]


class StateSensor(Sensor, frozen=True):
    """States of effects as drives measure them: a motor's current [A], or its angle [rad] before an elastic joint.

    Parameters
    ----------
    names : tuple of str
        As in run.states, such as "elbow.current"; in the order of the values.
    """

    names: tuple[str, ...]

    def check_beside(self, effects: Sequence[Effect], robot: Robot) -> None:
        """Require states that the effects have."""
        start = KinematicState(robot.model, mechanism(robot.model), list(robot.neutral), [0.0] * robot.nv, 0.0, Numbers)
        every = [part for one in effects for part in one.acting()]
        check_subset(self.names, [name for one in every for name in one.states(start)], "names", "state")

    def read(self, seen: Seen) -> Array:
        """The states (n, m)."""
        return np.stack([seen.z[name] for name in self.names], axis=1)


class TorqueSensor(_OfJoints, frozen=True):
    """Torques and forces that effects apply in joints, as in run.tau, N m or N; before a tick changes them.

    Parameters
    ----------
    joints : tuple of str
        Joints with one degree of freedom, in the order of the values.
    """

    of_forces: ClassVar[bool] = True

    def read(self, seen: Seen) -> Array:
        """The torques (n, m)."""
        return seen.forces.tau[:, self.dofs(seen.robot)]


class _OfLink(Sensor, frozen=True):
    """A sensor at the frame of a link.

    Parameters
    ----------
    link : str
        A link that moves.
    """

    link: LinkName


class Imu(_OfLink, frozen=True):
    """A gyroscope [rad/s] and an accelerometer [m/s^2] at a link's frame, along its axes: (w, a - g), 6 values.

    Parameters
    ----------
    link : str
        A link that moves.
    """

    of_forces: ClassVar[bool] = True

    def read(self, seen: Seen) -> Array:
        """Angular velocities and specific forces (n, 6)."""
        frame = seen.robot.model.getFrameId(self.link, pin.FrameType.BODY)  # a joint may have its name

        def of(model: pin.Model, data: pin.Data, i: int) -> Array:
            del i
            pin.updateFramePlacement(model, data, frame)
            moving = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
            a = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
            return np.concatenate([moving.angular, a - data.oMf[frame].rotation.T @ model.gravity.linear])

        return seen.by_pinocchio(of)


class PoseSensor(_OfLink, frozen=True):
    """Position [m] and orientation (quaternion x y z w) of a link's frame in the world, 7 values.

    Parameters
    ----------
    link : str
        A link that moves.
    """

    def read(self, seen: Seen) -> Array:
        """Positions and quaternions (n, 7)."""
        rotation, position = seen.robot.frame_pose(seen.q, self.link)
        turned = [pin.Quaternion(one).coeffs() for one in rotation]
        return np.concatenate([position, turned], axis=1)


class ForceTorque(Sensor, frozen=True):
    """The wrench from a joint's parent link on its child link, along the joint's axes: force [N], moment [N m].

    Parameters
    ----------
    joint : str
        Of a robot without kinematic loops and contacts.
    """

    of_forces: ClassVar[bool] = True

    joint: JointName

    def check_beside(self, effects: Sequence[Effect], robot: Robot) -> None:
        """Require that no link bears forces that no joint transmits."""
        del robot
        joining = Contact, PlaneContact, PointLoop, HingeLoop, WeldLoop
        every = [*effects, *(one for effect in effects for one in effect.acting())]
        other = next((one for one in every if isinstance(one, joining)), None)
        if other is not None:
            raise SceneError(f"it leaves the forces of {type(other).__name__} out", where="joint",
                             remedy="TorqueSensor, TouchSensor or run.contact_forces", code="not-seen")  # fmt: skip

    def read(self, seen: Seen) -> Array:
        """Forces and moments (n, 6)."""
        joint = seen.robot.model.getJointId(self.joint)
        return seen.by_pinocchio(lambda _, data, __: data.f[joint].vector.copy())


class TouchSensor(_OfLink, frozen=True):
    """The sum of the contact forces on a link along the world's axes, N.

    Parameters
    ----------
    link : str
        A link that moves.
    """

    of_forces: ClassVar[bool] = True

    def read(self, seen: Seen) -> Array:
        """The forces (n, 3)."""
        return seen.forces.on(self.link)
