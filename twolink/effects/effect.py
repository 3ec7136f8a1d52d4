"""The interface of all effects: their place in scene files, and what they may do to a robot."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from twolink.algorithms.motion import KinematicState, placed
from twolink.algorithms.spatial import ZERO, Scalar, Vec, add, cross, force_to_parent, inward, plus
from twolink.errors import SceneError, require_known
from twolink.io.text import kebab_case

if TYPE_CHECKING:
    import pinocchio as pin

    from twolink.dynamics import Robot

# Types of fields. What they say beside the type is for JSON Schema, of which forms are made, and for `checks`.
NotNegative = Annotated[float, msgspec.Meta(extra_json_schema={"minimum": 0.0})]
AboveZero = Annotated[float, msgspec.Meta(extra_json_schema={"exclusiveMinimum": 0.0})]
Share = Annotated[float, msgspec.Meta(extra_json_schema={"minimum": 0.0, "maximum": 1.0})]
SomeShare = Annotated[float, msgspec.Meta(extra_json_schema={"exclusiveMinimum": 0.0, "maximum": 1.0})]
Direction = Annotated[tuple[float, float, float], msgspec.Meta(extra_json_schema={"format": "direction"})]
LinkName = Annotated[str, msgspec.Meta(extra_json_schema={"format": "link"})]  # of a link that moves
PlaceName = Annotated[str, msgspec.Meta(extra_json_schema={"format": "link", "ground": True})]  # of a link, or GROUND
JointName = Annotated[str, msgspec.Meta(extra_json_schema={"format": "joint"})]  # of a joint that moves
SingleJoint = Annotated[str, msgspec.Meta(extra_json_schema={"format": "joint", "freedom": "one"})]
CoordinateJoint = Annotated[str, msgspec.Meta(extra_json_schema={"format": "joint", "freedom": "coordinate"})]


def quantity(letter: str, **bounds: float) -> msgspec.Meta:
    """Say of values by joint that they are q, v or tau of the joint: numbers, or texts with a unit such as "30 deg"."""
    return msgspec.Meta(extra_json_schema={"quantity": letter, **bounds})


Place = Annotated[float | str, quantity("q")]
Gap = Annotated[float | str, quantity("q", minimum=0.0)]
Speed = Annotated[float | str, quantity("v", exclusiveMinimum=0.0)]
Effort = Annotated[float | str, quantity("tau")]
Load = Annotated[float | str, quantity("tau", minimum=0.0)]  # an effort without a sign
SomeLoad = Annotated[float | str, quantity("tau", exclusiveMinimum=0.0)]


def of(field: str, *, each: bool = False) -> msgspec.Meta:
    """Say of values by joint that their joints are some of those of another field, or each of them."""
    return msgspec.Meta(extra_json_schema={"of": field, "each": True} if each else {"of": field})


class Loads:
    """Torques tau (nv) and, by body, the wrench (force, moment) at its joint's origin along its own axes.

    rates: of the states of effects, by name, per second.
    sides: of each limit of effort, on which side it stays, -1 below, 0 within, 1 above; None: as the torque is.
    """

    def __init__(self, motion: KinematicState, sides: Sequence[Scalar] | None = None) -> None:
        self.sides = sides
        self._motion = motion
        self.tau: list[Scalar] = [0.0] * motion.mech.nv
        self.wrenches: dict[int, list[Scalar]] = {}
        self.limits: list[tuple[str, Scalar]] = []  # of effort, by name: distances to them, which pass 0

        self.rates: dict[str, Scalar] = {}

    def of_motor(self, motion: KinematicState) -> Loads:
        """Loads of what drives a motor: their torques are its own; rates and limits are common."""
        own = copy.copy(self)
        own._motion, own.tau, own.wrenches = motion, [0.0] * motion.mech.nv, {}
        return own

    def beyond(self, name: str, lower: Scalar, upper: Scalar, xp: Any) -> tuple[Any, Any]:
        """Two conditions: a value is below, or above, its limits, by its distances to them (above 0 within).

        Events locate where they pass 0, so that no step crosses what is not smooth.
        """
        before = len(self.limits) // 2
        self.limits += [(f"{name}, lower", lower), (f"{name}, upper", upper)]
        if self.sides is None:
            return xp.less(lower, 0.0), xp.less(upper, 0.0)
        return xp.less(self.sides[before], -0.5), xp.less(0.5, self.sides[before])

    def torque(self, dof: int, value: Scalar) -> None:
        """Add a joint torque or force, N m or N."""
        self.tau[dof] = plus(self.tau[dof], value)

    def torques(self, values: Sequence[Scalar]) -> None:
        """Add torques (nv) of all degrees of freedom."""
        self.tau = [plus(own, value) for own, value in zip(self.tau, values, strict=True)]

    def force(self, frame: str, force: Vec, moment: Vec = ZERO, point: Vec = ZERO, *, lever: Vec = ZERO,
              axes: Literal["world", "frame"] = "world") -> None:  # fmt: skip
        """Add a force [N] at a point of a frame, and a moment [N m], both along the world's axes, or the frame's.

        lever: along the same axes, from the point to where the force acts, m.
        """
        i, place = self._motion.frame(frame)
        if i == 0:
            return  # on the ground
        if lever is not ZERO:
            moment = add(moment, cross(lever, force))
        if axes == "frame":
            self.wrench(i, *force_to_parent(place, (force, add(moment, cross(point, force)))))
            return
        body = self._motion.body(i)
        own, turning = inward(body, force), inward(body, moment)
        turning = add(turning, cross(placed(place, point), own))
        self.wrench(i, own, turning)

    def wrench(self, body: int, force: Vec, moment: Vec) -> None:
        """Add a force and a moment at the origin of a body's joint, along its own axes."""
        before = self.wrenches.get(body, [0.0] * 6)
        self.wrenches[body] = [plus(a, b) for a, b in zip(before, (*force, *moment), strict=True)]


class Effect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag=kebab_case):
    """One thing a scene calls for. In a scene file its `type` is the class's name in lower case, with hyphens.

    An effect may change the robot's constants (`change`), or act on the moving robot (`act`), or both. What it does
    is written once, over plain arithmetic: NumPy runs it beside Pinocchio, the machine runs its tape.
    """

    touches: ClassVar[bool] = False  # whether bodies touch by it
    is_sensor: ClassVar[bool] = False

    @property
    def analytic(self) -> bool:
        """True if the effect is smooth to any order, as Taylor's method needs."""
        return True

    @property
    def changes(self) -> bool:
        """True if the effect changes constants of the robot."""
        return type(self).change is not Effect.change

    @property
    def sampled(self) -> Any:
        """The sampled controller that it is, or that a drive has inside; None for others."""
        return None

    def held(self, robot: Robot, place: int) -> Effect:
        """The effect that acts between the ticks of its sampled controller; place: of the effect in its scene."""
        del robot, place
        return self

    def acting(self) -> tuple[Effect, ...]:
        """The effects in its place, until an event lets go of them."""
        return (self,)

    def check(self, robot: Robot) -> None:
        """Raise SceneError where the effect does not fit the robot; `where` begins with the field's name.

        `checks` has checked before that the fields have their declared types, with finite numbers.
        """

    def check_beside(self, effects: Sequence[Effect], robot: Robot) -> None:
        """Raise SceneError where the effect does not fit the effects of its scene."""

    def change(self, model: pin.Model) -> None:
        """Change the constants of a model that belongs to the scene alone."""

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add the torques on joints and the wrenches on bodies that the effect gives to a motion."""

    def viscosity(self, robot: Robot) -> Mapping[str, float]:
        """d of its torques -d v on joints of one degree of freedom, which steps through contacts take implicitly."""
        del robot
        return {}

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """The states z of the effect beside q and v, by name, and their values at the start, of a motion at t = 0.

        `act` finds them in `motion.states`, and gives z' by `loads.rates`.
        """
        del motion
        return {}

    def notes(self, robot: Robot) -> Sequence[str]:
        """Notes of `explain` on the effect beside its fields, one line each."""
        del robot
        return ()

    def pieces(self) -> Sequence[Any]:
        """Pieces (pin.GeometryObject) that are fixed to the world, to draw beside the robot."""
        return ()

    def breaks(self, duration: float) -> Sequence[float]:
        """The times [s] below the duration at which what it does is not smooth."""
        del duration
        return ()


def number(x: Any) -> Any:
    """A number as a float, which formulas fold as a constant; a run-time parameter in its place as it is."""
    return float(x) if isinstance(x, (int, float, np.number)) else x


def inverse(x: Any) -> Any:
    """1 / x of a number of an effect."""
    return 1.0 / number(x)


def plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, for what is written down. Raises TypeError for anything else."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} cannot be written down")


def check_name(name: str, known: Iterable[str], field: str, what: str) -> None:
    """Require that a name is known. Raises SceneError with the nearest right one."""
    require_known(name, known, SceneError, f"there is no {what} {{!r}}", where=field)


def finite(value: float, field: str, *, least: float = -math.inf) -> None:
    """Require a finite number, not below `least`. Raises SceneError."""
    if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= least):
        bound = "" if least == -math.inf else f" of at least {least:g}"
        raise SceneError(f"expected a finite number{bound}, got {value!r:.60}", where=field, remedy="give SI units")


def all_finite(values: Sequence[float], field: str) -> None:
    """Require finite numbers in a list or tuple. Raises SceneError."""
    numbers = values if isinstance(values, (list, tuple)) else (None,)
    if not all(isinstance(number, (int, float)) and math.isfinite(number) for number in numbers):
        raise SceneError(f"expected finite numbers, got {values!r:.60}", where=field, remedy="give SI units")
