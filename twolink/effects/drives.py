"""Drives: what is between a command and a joint, with states of their own. Each acts on what is inside it, `of`.

ActuatorLag(of=JointPD(...)) delays the torques of the controller. Gear(of=DCMotor(of=PID(...))) is a geared motor whose
voltage a controller gives: inside a gear or an elastic joint, angles and speeds are those of the motor, and torques act
on the motor; inside a motor, torques are its voltages.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
import pinocchio as pin

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Scalar, minus, negative, plus, times
from twolink.dynamics import Robot
from twolink.effects.checks import check_effect, check_joints, errors_inside
from twolink.effects.controllers import ComputedTorque, GravityCompensation
from twolink.effects.effect import AboveZero, Effect, Effort, Gap, Loads, NotNegative, SomeShare, inverse, number, of
from twolink.effects.inputs import Input, value_at
from twolink.effects.loops import Loop
from twolink.effects.switching import SwitchingEffect
from twolink.errors import SceneError


class Drive(Effect, frozen=True):
    """A drive: an effect that acts on the torques of another one, `of`."""

    of_motor: ClassVar[bool] = False  # whether the commands inside are other quantities than the joint's

    of: Any = None  # an Effect: scene files read it by its type

    @property
    def inmost(self) -> Any:
        """The innermost effect, which is no drive."""
        return self.of.inmost if isinstance(self.of, Drive) else self.of

    @property
    def analytic(self) -> bool:
        """True if the effect inside is analytic, or there is none."""
        return self.of is None or self.of.analytic

    @property
    def changes(self) -> bool:
        """True if the effect inside changes the robot."""
        return self.of is not None and self.of.changes

    @property
    def sampled(self) -> Any:
        """The sampled controller inside."""
        return getattr(self.of, "sampled", None)

    def held(self, robot: Robot, place: int) -> Effect:
        """The drive with what its sampled controller holds."""
        return msgspec.structs.replace(self, of=self.of.held(robot, place))

    def check_inside(self, robot: Robot, joints: Any, field: str, *, needed: bool = True) -> None:
        """Require joints of one coordinate, and inside an effect that gives torques. Raises SceneError."""
        check_joints(joints, robot, field, coordinates=True)
        if self.of is None and not needed:
            return
        if not isinstance(self.of, Effect) or isinstance(self.of, (SwitchingEffect, Loop)):
            missing = "the effect that drives the joints is missing"
            what = missing if self.of is None else f"{type(self.of).__name__} gives no torque of a drive"
            raise SceneError(what, where="of", remedy="give a controller, a motor or tl.effects.Torque")
        with errors_inside():
            check_effect(self.of, robot)
        limits = getattr(self.inmost, "effort", None), getattr(self.inmost, "limit", None)
        if self.of_motor and "urdf" in limits:
            raise SceneError("the URDF's limits of effort are of joints, not of motors or voltages", where="of",
                             remedy="give limits by joint, of the torque before a gear or of the voltage")  # fmt: skip

    def change(self, model: pin.Model) -> None:
        """Change the robot as the effect inside does."""
        if self.of is not None:
            self.of.change(model)

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """States of the effect inside."""
        return {} if self.of is None else self.of.states(self.seen_inside(motion))

    def breaks(self, duration: float) -> Sequence[float]:
        """The times [s] at which the effect inside is not smooth."""
        return () if self.of is None else self.of.breaks(duration)

    def inside(self, motion: KinematicState, loads: Loads) -> list[Scalar]:
        """The torques (nv) of what is inside, which sees a motion."""
        own = loads.of_motor(motion)
        if self.of is not None:
            self.of.act(motion, own)
        if own.wrenches:
            raise SceneError(f"{type(self.of).__name__} gives forces on links, not torques of joints", where="of",
                             remedy="leave it outside")  # fmt: skip
        return own.tau

    def seen_inside(self, motion: KinematicState) -> KinematicState:
        """The motion as what is inside sees it."""
        return motion


class ActuatorLag(Drive, frozen=True):
    """An actuator that follows its command with a lag of first order: T z' = u - z, tau = z.

    Parameters
    ----------
    of : Effect
        What gives the command u, such as a controller. Joints that `time` does not name get it without a lag.
    time : mapping of joint to float
        T, s, above 0.
    start : mapping of joint to float
        z at the start, N m or N; 0 by default.

    Notes
    -----
    States: "JOINT.lag", N m or N. Limits of effort of what is inside act on the command.

    References
    ----------
    Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2019, section 3.3.
    """

    time: Mapping[str, AboveZero] = {}
    start: Annotated[Mapping[str, Effort], of("time")] = {}

    def check(self, robot: Robot) -> None:
        """Require something inside."""
        self.check_inside(robot, self.time, "time")

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """z of each joint."""
        return {**super().states(motion), **{f"{j}.lag": number(self.start.get(j, 0.0)) for j in self.time}}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add z."""
        commands = self.inside(motion, loads)
        for joint, time in self.time.items():
            dof, z = motion.coordinate(joint)[1], motion.states[f"{joint}.lag"]
            loads.rates[f"{joint}.lag"] = times(minus(commands[dof], z), inverse(time))
            commands[dof] = z
        loads.torques(commands)


class Winding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The heat of a motor's winding: C theta' = R (1 + alpha theta) i^2 - G theta, theta above its surroundings.

    Parameters
    ----------
    capacity : float
        C, J/K, above 0.
    cooling : float
        G, W/K: the heat that it gives off.
    copper : float
        alpha, 1/K: how its resistance rises; 0.00393 for copper at 20 degrees.
    magnet : float
        1/K: how the torque constant falls, as K (1 - magnet theta), 0 by default; 0.001 to 0.002 for magnets.
    """

    capacity: AboveZero
    cooling: NotNegative
    copper: NotNegative = 0.00393
    magnet: NotNegative = 0.0


class DCMotor(Drive, frozen=True):
    """A motor with brushes, or its like: L i' = u - R i - K w, tau = K i, w its speed.

    Parameters
    ----------
    of : Effect, optional
        What gives the voltage u, such as a controller, whose torques are read as V.
    resistance : mapping of joint to float
        R, ohm, not negative; for each joint with a motor. Joints with one coordinate.
    inductance : mapping of joint to float
        L, H, above 0; for each motor.
    constant : mapping of joint to float
        K, N m/A = V s/rad; for each motor.
    voltage : mapping of joint to input
        V, beside what is inside: numbers or functions of time.
    start : mapping of joint to float
        i at the start, A; 0 by default.
    winding : Winding, optional
        Its heat: resistance and torque constant then change with its temperature.

    Notes
    -----
    States: "JOINT.current", A, and with a winding "JOINT.winding", the temperature above the surroundings, K.
    Inside a `Gear` or an `ElasticJoint` w is the speed of the rotor, else that of the joint.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 5.2.1.
    """

    of_motor: ClassVar[bool] = True

    resistance: Mapping[str, NotNegative] = {}
    inductance: Annotated[Mapping[str, AboveZero], of("resistance", each=True)] = {}
    constant: Annotated[Mapping[str, float], of("resistance", each=True)] = {}
    voltage: Annotated[Mapping[str, Input], of("resistance")] = {}
    start: Annotated[Mapping[str, float], of("resistance")] = {}
    winding: Winding | None = None

    def check(self, robot: Robot) -> None:
        """Require R, L and K of each motor."""
        self.check_inside(robot, self.resistance, "resistance", needed=False)

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """The currents and temperatures."""
        currents = {f"{joint}.current": number(self.start.get(joint, 0.0)) for joint in self.resistance}
        heat = {f"{joint}.winding": 0.0 for joint in self.resistance if self.winding is not None}
        return {**super().states(motion), **currents, **heat}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add K i, and give i' and the winding's temperature."""
        voltages = self.inside(motion, loads)
        for joint, resistance in self.resistance.items():
            dof, i = motion.coordinate(joint)[1], motion.states[f"{joint}.current"]
            r, k = number(resistance), number(self.constant[joint])
            if (heat := self.winding) is not None:
                theta = motion.states[f"{joint}.winding"]
                r = times(r, plus(1.0, times(number(heat.copper), theta)))
                k = times(k, minus(1.0, times(number(heat.magnet), theta)))
                given_off = times(number(heat.cooling), theta)
                loads.rates[f"{joint}.winding"] = times(minus(times(r, times(i, i)), given_off), inverse(heat.capacity))
            u = plus(voltages[dof], value_at(self.voltage.get(joint, 0.0), motion.t, motion.xp))
            left = minus(minus(u, times(r, i)), times(k, motion.v[dof]))
            loads.rates[f"{joint}.current"] = times(left, inverse(self.inductance[joint]))
            voltages[dof] = 0.0
            loads.torque(dof, times(k, i))
        if any(type(u) is not float or u != 0.0 for u in voltages):
            raise SceneError("what is inside gives a voltage to a joint without a motor", where="of",
                             remedy="give each of its joints a resistance")  # fmt: skip


class Gear(Drive, frozen=True):
    """A stiff gear: the motor's angle is N q, and the joint's torque N tau less what the gear loses.

        tau_q = N tau (a - b tanh(N tau v / P)),   a = (e + 1 / e_b) / 2,   b = (1 / e_b - e) / 2

    Driven by the motor the joint has N tau e, and driven by the joint it needs N tau / e_b.

    Parameters
    ----------
    of : Effect
        What drives it, such as a motor: its angles, speeds and torques are those of the motor. What computes torques
        of the links, such as `GravityCompensation`, stands beside the gear.
    ratio : mapping of joint to float
        N, not 0. Joints with one coordinate.
    efficiency : mapping of joint to float
        e, above 0 and at most 1, which is the default: of power from the motor to the joint.
    backward : mapping of joint to float
        e_b, the same from the joint to the motor; e by default.
    inertia : mapping of joint to float
        Of the rotor, kg m^2: N^2 times it is added to the joint's armature. Of a gear inside it counts with both N.
    power : float
        P, W, above 0: the power at which the loss has three quarters of its size; below it the gear creeps.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 5.1.1.
    """

    of_motor: ClassVar[bool] = True

    ratio: Mapping[str, float] = {}
    efficiency: Annotated[Mapping[str, SomeShare], of("ratio")] = {}
    backward: Annotated[Mapping[str, SomeShare], of("efficiency")] = {}
    inertia: Annotated[Mapping[str, NotNegative], of("ratio")] = {}
    power: AboveZero = 0.1

    @property
    def changes(self) -> bool:
        """True if it has a rotor, or the effect inside changes the robot."""
        return bool(self.inertia) or super().changes

    def check(self, robot: Robot) -> None:
        """Require ratios, and nothing inside that computes torques of the links."""
        self.check_inside(robot, self.ratio, "ratio")
        if isinstance(self.inmost, (GravityCompensation, ComputedTorque)):
            raise SceneError(f"{type(self.inmost).__name__} would take the motor's angles for those of the links",
                             where="of", remedy="make it an effect beside the gear")  # fmt: skip
        for joint in (joint for joint, ratio in self.ratio.items() if not ratio):
            raise SceneError("expected another number than 0", where=f"ratio.{joint}", remedy="leave the joint out")

    def change(self, model: pin.Model) -> None:
        """Add N^2 times the rotor's inertia to the armature, and of rotors inside, which turn as fast as the motor."""
        outside = np.array(model.armature)
        model.armature = np.zeros(model.nv)
        super().change(model)
        own = np.array(model.armature)
        for joint, ratio in self.ratio.items():
            dof = model.idx_vs[model.getJointId(joint)]
            own[dof] = float(ratio) ** 2 * (own[dof] + self.inertia.get(joint, 0.0))
        model.armature = outside + own

    def seen_inside(self, motion: KinematicState) -> KinematicState:
        """N q and N v."""
        rows = {joint: motion.coordinate(joint) for joint in self.ratio}
        return motion.driven_by({joint: (times(number(n), motion.q[rows[joint][0]]),
                                         times(number(n), motion.v[rows[joint][1]]))
                                 for joint, n in self.ratio.items()})  # fmt: skip

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add N tau (a - b tanh(N tau v / P))."""
        torques = self.inside(self.seen_inside(motion), loads)
        for joint, ratio in self.ratio.items():
            dof = motion.coordinate(joint)[1]
            tau = times(number(ratio), torques[dof])
            if joint in self.efficiency:
                forward, backward = number(self.efficiency[joint]), self.backward.get(joint, self.efficiency[joint])
                mean, half = 0.5 * (forward + inverse(backward)), 0.5 * (inverse(backward) - forward)
                way = motion.xp.tanh(times(inverse(self.power), times(tau, motion.v[dof])))
                tau = times(tau, minus(mean, times(half, way)))
            torques[dof] = tau
        loads.torques(torques)


class MotorOnSpring(Drive, frozen=True):
    """A motor with a coordinate of its own, theta and its speed w, in the joint's units: J w' = tau - f."""

    stiffness: Mapping[str, NotNegative] = {}
    inertia: Annotated[Mapping[str, AboveZero], of("stiffness", each=True)] = {}
    cubic: Annotated[Mapping[str, NotNegative], of("stiffness")] = {}
    damping: Annotated[Mapping[str, NotNegative], of("stiffness")] = {}

    def check(self, robot: Robot) -> None:
        """Require an inertia for each spring, and no rotor inside: it would be added to the link, past the spring."""
        self.check_inside(robot, self.stiffness, "stiffness")
        if self.of.changes:
            raise SceneError(f"{type(self.of).__name__} changes the inertia of the link, not of the motor on a spring",
                             where="of", remedy="add N^2 times the rotor's inertia to `inertia`")  # fmt: skip

    def seen_inside(self, motion: KinematicState) -> KinematicState:
        """theta and w; at the start q and v."""
        names = [joint for joint in self.stiffness if f"{joint}.motor" in motion.states]
        return motion.driven_by({joint: (motion.states[f"{joint}.motor"], motion.states[f"{joint}.motor_speed"])
                                 for joint in names})  # fmt: skip

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """theta and w."""
        own: dict[str, Scalar] = {}
        for joint in self.stiffness:
            entry, dof = motion.coordinate(joint)
            own |= {f"{joint}.motor": motion.q[entry], f"{joint}.motor_speed": motion.v[dof]}
        return {**super().states(motion), **own}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add f, and give theta' and w'."""
        motor = self.seen_inside(motion)
        torques = self.inside(motor, loads)
        for joint, inertia in self.inertia.items():
            entry, dof = motion.coordinate(joint)
            force = self.force(joint, minus(motor.q[entry], motion.q[entry]), minus(motor.v[dof], motion.v[dof]),
                               loads, motion.xp)  # fmt: skip
            loads.rates[f"{joint}.motor"] = motor.v[dof]
            loads.rates[f"{joint}.motor_speed"] = times(minus(torques[dof], force), inverse(inertia))
            torques[dof] = force
        loads.torques(torques)

    def force(self, joint: str, twist: Scalar, rate: Scalar, loads: Loads, xp: Any) -> Scalar:
        """f, the torque on the joint, from d = theta - q and its rate: k d + c d^3 + b d'."""
        del loads, xp
        return self.spring(joint, twist, rate)

    def spring(self, joint: str, twist: Scalar, rate: Scalar) -> Scalar:
        """k d + c d^3 + b d'."""
        cubic = times(number(self.cubic.get(joint, 0.0)), times(twist, times(twist, twist)))
        return plus(times(number(self.stiffness[joint]), twist), cubic,
                    times(number(self.damping.get(joint, 0.0)), rate))  # fmt: skip


class ElasticJoint(MotorOnSpring, frozen=True):
    """A motor on a spring, in series with the joint: J w' = tau - f, f = k d + c d^3 + b (w - v), d = theta - q.

    theta and w are angle and speed of the motor, as the joint sees them; f is the torque on the joint. A harmonic drive
    stiffens: c > 0.

    Parameters
    ----------
    of : Effect
        What drives the motor; its angles and speeds are theta and w.
    stiffness : mapping of joint to float
        k, N m/rad or N/m, not negative. Joints with one coordinate.
    inertia : mapping of joint to float
        J, kg m^2 or kg, above 0; of a motor behind a gear N^2 times its own.
    cubic : mapping of joint to float
        c, N m/rad^3 or N/m^3, not negative; 0 by default.
    damping : mapping of joint to float
        b, N m s/rad or N s/m, not negative; 0 by default.

    Notes
    -----
    States: "JOINT.motor", theta, and "JOINT.motor_speed", w. At the start the spring is relaxed, and the motor moves as
    the joint does. The motor's own turning does not act on the links that carry it.

    References
    ----------
    Spong 1987, Journal of Dynamic Systems, Measurement, and Control 109(4), 310-318. Tuttle, Seering 1996, IEEE
    Transactions on Robotics and Automation 12(3), 368-374 (cubic stiffness of harmonic drives).
    """


class Backlash(MotorOnSpring, frozen=True):
    """A motor that drives the joint with play: J w' = tau - f, f = k p + c p^3 + b |p| (w - v).

    p is how far the flanks are pressed, from d = theta - q: 0 while |d| < gap / 2.

    Parameters
    ----------
    of, stiffness, inertia, cubic
        As of `ElasticJoint`; the spring is that of the teeth.
    damping : mapping of joint to float
        b, N m s/rad^2 or N s/m^2, not negative, of Hunt and Crossley: without a jump of the force where flanks meet.
    gap : mapping of joint to float
        The play, from one flank to the other, rad or m, not negative.

    Notes
    -----
    Events of the kind "limit" locate where the flanks meet and part, so that no step crosses them. At the start the
    motor is in the middle of the gap.

    References
    ----------
    Nordin, Gutman 2002, Automatica 38(10), 1633-1649. Hunt, Crossley 1975, Journal of Applied Mechanics 42(2), 440-445.
    """

    gap: Annotated[Mapping[str, Gap], of("stiffness", each=True)] = {}

    analytic: ClassVar[bool] = False  # only between contacts

    def force(self, joint: str, twist: Scalar, rate: Scalar, loads: Loads, xp: Any) -> Scalar:
        """f, from how far the flanks are pressed."""
        half = 0.5 * number(self.gap[joint])
        below, above = loads.beyond(joint, plus(twist, half), minus(half, twist), xp)
        pressed = xp.where(below, plus(twist, half), xp.where(above, minus(twist, half), 0.0))
        size = xp.where(below, negative(pressed), pressed)
        return self.spring(joint, pressed, times(size, rate))
