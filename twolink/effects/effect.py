"""What all effects have in common: their place in scene files, and what they may do to a robot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from twolink.algorithms.motion import Motion, placed
from twolink.algorithms.spatial import ZERO, Scalar, Vec, add, cross, inward, plus
from twolink.errors import SceneError, require_known
from twolink.io.text import kebab_case

if TYPE_CHECKING:
    import pinocchio as pin

    from twolink.dynamics import Robot

# A number that is not negative, for fields. The bound is for JSON Schema and `checks`, which names the field.
NotNegative = Annotated[float, msgspec.Meta(extra_json_schema={"minimum": 0.0})]
# Names, for fields. The format is for JSON Schema: forms offer the robot's names. Each effect checks its names.
LinkName = Annotated[str, msgspec.Meta(extra_json_schema={"format": "link"})]
JointName = Annotated[str, msgspec.Meta(extra_json_schema={"format": "joint"})]


class Loads:
    """Torques tau (nv) and, by body, the wrench (force, moment) at its joint's origin along its own axes.

    sides: of each limit of effort, on which side it stays, -1 below, 0 within, 1 above; None: as the torque is.
    """

    def __init__(self, motion: Motion, sides: Sequence[Scalar] | None = None) -> None:
        self.sides = sides
        self._motion = motion
        self.tau: list[Scalar] = [0.0] * motion.mech.nv
        self.wrenches: dict[int, list[Scalar]] = {}
        self.limits: list[tuple[str, Scalar]] = []  # of effort, by name: distances to them, which pass 0

    def torque(self, dof: int, value: Scalar) -> None:
        """Add a joint torque or force, N m or N."""
        self.tau[dof] = plus(self.tau[dof], value)

    def force(self, frame: str, force: Vec, moment: Vec = ZERO, point: Vec = ZERO) -> None:
        """Add a force [N] at a point of a frame, and a moment [N m], both along the world's axes."""
        i, place = self._motion.frame(frame)
        if i == 0:
            return  # on the ground
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
    is written once, over plain arithmetic: NumPy runs it beside Pinocchio, heyoka compiles it.
    """

    touches: ClassVar[bool] = False  # whether bodies touch by it
    at_ticks: ClassVar[Literal["", "controller", "sensor"]] = ""  # what it is, if it is called at ticks

    @property
    def analytic(self) -> bool:
        """Whether what it does is smooth to any order, as Taylor's method needs."""
        return True

    def check(self, robot: Robot) -> None:
        """Raise SceneError where the effect does not fit the robot; `where` begins with the field's name.

        `checks` has checked before that the fields have their declared types, with finite numbers.
        """

    def change(self, model: pin.Model) -> None:
        """Change the constants of a model that belongs to the scene alone."""

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add the torques on joints and the wrenches on bodies that the effect gives to a motion."""

    def notes(self, robot: Robot) -> Sequence[str]:
        """What `explain` says of the effect beside its fields, one line each."""
        del robot
        return ()

    def breaks(self, duration: float) -> Sequence[float]:
        """The times [s] below the duration at which what it does is not smooth."""
        del duration
        return ()


def number(x: Any) -> Any:
    """A number as a float, which formulas fold as a constant; a run-time parameter in its place as it is."""
    return float(x) if isinstance(x, (int, float, np.number)) else x


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
        raise SceneError(f"expected a finite number{bound}, got {value!r}", where=field, remedy="give SI units")


def all_finite(values: Sequence[float], field: str) -> None:
    """Require finite numbers in a list or tuple. Raises SceneError."""
    numbers = values if isinstance(values, (list, tuple)) else (None,)
    if not all(isinstance(number, (int, float)) and math.isfinite(number) for number in numbers):
        raise SceneError(f"expected finite numbers, got {values!r}", where=field, remedy="give SI units")
