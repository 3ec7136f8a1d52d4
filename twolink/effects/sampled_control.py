"""Sampled controllers: plain Python, called at ticks, whose torques are held between them."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar, Literal

import msgspec
import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import minus, plus, times
from twolink.dynamics import Robot
from twolink.dynamics.arguments import whole
from twolink.effects.checks import check_joints, check_subset, single_joints
from twolink.effects.controllers import Limits, check_limits, limit_of
from twolink.effects.effect import Effect, Loads
from twolink.effects.inputs import Slot
from twolink.errors import SceneError

Seconds = float | Fraction
STATE = "q", "v"  # of the robot, among the inputs of a controller
LARGEST_DENOMINATOR = 10**6  # of a time that is meant as a fraction, such as 1 / 240


def exact(seconds: Seconds) -> Fraction:
    """A time as the fraction that was meant: 0.001 is 1/1000, and 1 / 240 is 1/240."""
    if not isinstance(seconds, float):
        return Fraction(seconds)
    short = Fraction(seconds).limit_denominator(LARGEST_DENOMINATOR)
    return short if float(short) == seconds else Fraction(repr(seconds))


def check_clock(period: Seconds, delays: Mapping[str, Seconds], seed: int) -> None:
    """Require a period above 0, other times that are not negative, and a seed. Raises SceneError."""
    whole(seed, "seed", SceneError)
    for name, value in (("period", period), *delays.items()):
        if not np.isfinite(float(value)) or value < 0 or (name == "period" and value == 0):
            raise SceneError(f"expected a time {'above' if name == 'period' else 'of at least'} 0 s, got {value!r:.60}",
                             where=name, remedy="give seconds, such as 1e-3 or Fraction(1, 240)")  # fmt: skip


class HeldTorques(Effect, frozen=True):
    """Torques that are constant, or change at a constant rate, from tick to tick: tau = value + slope (t - since).

    The numbers are rows of the state.
    """

    analytic: ClassVar[bool] = False

    values: Mapping[str, Slot]
    slopes: Mapping[str, Slot] = {}
    since: Slot | None = None

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add the held torques."""
        for joint, value in self.values.items():
            if joint in self.slopes:
                value = plus(value, times(self.slopes[joint], minus(motion.t, self.since)))
            loads.torque(motion.dofs(joint)[0], value)


class DofTorques(Effect, frozen=True):
    """Generalized forces of all degrees of freedom, in order, which are rows of the state."""

    analytic: ClassVar[bool] = False

    values: Mapping[str, Slot]

    def act(self, motion: KinematicState, loads: Loads) -> None:  # noqa: ARG002 what all effects are given
        """Add them."""
        loads.torques(list(self.values.values()))


class Controller(Effect, frozen=True):
    """A sampled controller in plain Python: torques of joints that are computed at ticks and held between them.

    At t_k = offset + k period, `update(t, y, state) -> (u, state)`; from t_k + delay on tau = u_k, until u_{k+1} acts.

    Parameters
    ----------
    update : callable
        (t, y, state) -> (u, state). t: the time of the tick, s. y: copies of what was asked for, by name: y.q, y.v,
        y.LINK or y["LINK"] (a pose, 4 x 4), and the readings of sensors of the scene that arrived last. u: one torque
        [N m or N] an output, in their order. What changes from tick to tick is in the state, or in the object whose
        method this is: each solution has a copy (copy.deepcopy) of the object as it is when solving begins, and the
        object itself is never called. A class, or functools.partial of one, makes a new object for each solution. A
        function has one closure for all of them: it must give the same answer to the same arguments.
    period, offset, delay : float or Fraction
        s; the delay may be longer than the period. Ticks are exact: 0.001 is 1/1000, 1 / 240 is 1/240.
    jitter : float or Fraction
        Ticks are late by a random part of it, s, below the period; drawn by the seed.
    seed : int
        Of the jitter.
    state : object
        At the start; it is copied for each solution. Controllers whose updates are methods of one object keep it in
        common.
    inputs : tuple of str
        Of y: "q", "v", links, sensors; empty: the first two.
    outputs : tuple of str
        The joints that are driven, with one degree of freedom each; empty: all of these.
    hold : {"zero", "first"}
        "first": u goes on at the rate of the last two.
    limit : mapping of joint to float, "urdf" or None
        Saturation L, -L <= u <= L, N m or N: by joint, the URDF's, or none.
    traced : bool or "auto"
        Whether the law becomes a program, which runs for all solutions at once: True insists, False forbids.
    vectorized : bool
        The law takes rows: y.q is (n, nq), of n solutions, u (n, m), and of the state what it makes of the first one.
        The rows must not depend on each other.

    Notes
    -----
    A law is traced where it is a function that is seen to remember nothing but its state, of numbers and arrays, and
    computes u with operators and functions of NumPy that are known: branches by np.where, np.clip, np.minimum, no `if`
    on a value, no float(), no writes into arrays. It is called once with arrays that record this. A law that takes
    rows as well is called once a tick for all. Both are held against calls for each solution, beside the motion, at
    ticks 1, 2, 4, ... and every 256th, to rounding or to the bit; what differs is called for each from the start.
    `tl.explain` says which is done, and why.

    Before the first u acts, the torque is 0. Inside a drive u is what the drive takes: volts of a motor. Beside stops,
    dry friction and contacts events are located between ticks; stepped contacts have steps that end at ticks. Each of
    the solutions that make the error bar, three (without events) to seven, has its own controller state. A tick at
    which their answers differ by more than continuity explains, as those of a threshold or a quantizer do, is an event
    "ambiguous-tick" of the run, and the error bar widens from then on. Where the solutions part at an exponential
    rate, an event "unstable-loop" says from when and how fast.

    Laws that may remember something elsewhere (closures that change, globals, attributes of classes, random numbers,
    clocks, files) are called again behind the motion: each solution's ticks from the start, and questions beside it
    that were asked before. Another answer is an error (ControllerError, code "controller-not-repeatable"); so is what
    cannot be copied (SceneError, code "controller-not-copied"). A function whose code is seen to remember nothing is
    not called again.

    References
    ----------
    Åström, Wittenmark: Computer-Controlled Systems, 1997, chapters 2 and 3.
    """

    update: Any
    period: Seconds = 1e-3
    offset: Seconds = 0.0
    delay: Seconds = 0.0
    jitter: Seconds = 0.0
    seed: int = 0
    state: Any = None
    inputs: tuple[str, ...] = STATE
    outputs: tuple[str, ...] = ()
    hold: Literal["zero", "first"] = "zero"
    limit: Limits = None
    traced: bool | Literal["auto"] = "auto"
    vectorized: bool = False

    @property
    def sampled(self) -> Any:
        """Itself."""
        return self

    def check(self, robot: Robot) -> None:
        """Require a function, times, and joints with one degree of freedom."""
        if not callable(self.update):
            raise SceneError(f"expected a function, got {self.update!r:.60}", where="update",
                             remedy="(t, y, state) -> (u, state)")  # fmt: skip
        check_clock(self.period, {"offset": self.offset, "delay": self.delay, "jitter": self.jitter}, self.seed)
        if self.jitter and self.jitter >= self.period:
            raise SceneError("ticks would change their order", where="jitter", remedy="below the period")
        for name in ("inputs", "outputs"):
            if isinstance(getattr(self, name), str):
                raise SceneError("expected names, got one text", where=name,
                                 remedy=f'such as ("{getattr(self, name)}",)')  # fmt: skip
        if len({*self.outputs}) < len(self.outputs):
            raise SceneError(f"a joint is named twice in {self.outputs}", where="outputs", remedy="name each once")
        check_joints(self.joints(robot), robot, "outputs", dofs=True)
        check_limits(self.limit, self.joints(robot), robot, "limit")

    def on(self, robot: Robot) -> "Controller":
        """The controller on a robot, whose law may depend on it."""
        del robot
        return self if self.inputs else msgspec.structs.replace(self, inputs=STATE)  # so that laws see how many ask

    def joints(self, robot: Robot) -> tuple[str, ...]:
        """The driven joints."""
        return tuple(self.outputs) or tuple(single_joints(robot))

    def check_inputs(self, known: Sequence[str]) -> None:
        """Require inputs that the scene has. Raises SceneError."""
        check_subset(self.inputs, (*STATE, *known), "inputs", "quantity, link or sensor")

    def limits(self, robot: Robot) -> np.ndarray:
        """L of each output (m,), infinite where there is none."""
        values = (limit_of(joint, self.limit, robot.model) for joint in self.joints(robot))
        return np.array([np.inf if value is None else value for value in values], dtype=float)

    def held(self, robot: Robot, place: int) -> HeldTorques:
        """The held torques that act on the moving robot; place: of the controller among the scene's effects."""
        joints = self.joints(robot)
        values, slopes = (
            {joint: Slot(f"controller {place} {kind} {joint}") for joint in joints} for kind in ("value", "slope")
        )
        if self.hold == "zero":
            return HeldTorques(values)
        return HeldTorques(values, slopes, Slot(f"controller {place} since"))
