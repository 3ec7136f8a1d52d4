"""Scene: what is to be simulated, and nothing besides."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration
from twolink.effects import Effect, Gravity
from twolink.errors import SceneError


def duration_of(value: float) -> float:
    """A duration as a float: finite, above 0 [s]."""
    try:
        seconds = float(value)
    except (TypeError, ValueError):
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds > 0):
        raise SceneError(f"expected a time above 0 s, got {value!r}", where="duration", remedy="such as 10.0")
    return seconds


class Scene:
    """A robot, its initial state and the effects that act on it. Nothing is on by default, gravity included.

    Attributes:
        robot: the robot, in the gravity field of the scene's effects (none: zero).
        q, v: the initial configuration (nq,) and velocity (nv,); neutral and at rest unless given.
        effects: the effects, in order.
        duration: seconds to simulate unless `simulate` is told otherwise.
        title: one line on what the scene shows.
    """

    def __init__(
        self,
        robot: Robot,
        q: ArrayLike | None = None,
        v: ArrayLike | None = None,
        effects: Sequence[Effect] = (),
        duration: float = 10.0,
        title: str = "",
    ) -> None:
        if not isinstance(robot, Robot):
            raise SceneError(
                f"expected a Robot, got {type(robot).__name__}",
                where="robot",
                remedy="tl.load_robot(...) makes one",
            )
        self.effects: tuple[Effect, ...] = _checked(effects)
        self.robot: Robot = robot.with_gravity(self._gravity())
        self.q = configuration("q", robot.neutral if q is None else q, robot.nq, robot.joints).copy()
        self.v = array("v", np.zeros(robot.nv) if v is None else v, robot.nv).copy()
        for name, value, size in (("q", self.q, robot.nq), ("v", self.v, robot.nv)):
            if value.shape != (size,):
                raise SceneError(
                    f"expected one state of shape ({size},), got {value.shape}",
                    where=name,
                    remedy="a scene has one initial state",
                )
            value.flags.writeable = False
        self.duration = duration_of(duration)
        self.title = title

    def _gravity(self) -> np.ndarray:
        fields = [e.field for e in self.effects if isinstance(e, Gravity)]
        return np.array(fields[0]) if fields else np.zeros(3)

    def __repr__(self) -> str:
        names = ", ".join(type(e).__name__ for e in self.effects) or "free motion"
        return f"<Scene {self.robot.name!r}: {names}, {self.duration:g} s>"


def _checked(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    if isinstance(effects, Effect) or not isinstance(effects, Sequence):
        raise SceneError(f"expected a list of effects, got {type(effects).__name__}", where="effects",
                         remedy="such as [tl.effects.Gravity()]")  # fmt: skip
    for effect in effects:
        if not isinstance(effect, Effect):
            raise SceneError(
                f"expected effects, got {type(effect).__name__}",
                where="effects",
                remedy="such as [tl.effects.Gravity()]",
            )
    if sum(isinstance(e, Gravity) for e in effects) > 1:
        raise SceneError("gravity is given twice", where="effects", remedy="keep one")
    return tuple(effects)
