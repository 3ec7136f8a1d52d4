"""Scene: what is to be simulated, and nothing besides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration, positive
from twolink.effects import Effect
from twolink.errors import AccuracyError, SceneError, TwolinkError


def duration_of(value: float) -> float:
    """A duration as a float: finite, above 0 [s]."""
    return positive(value, "duration", SceneError, "such as 10.0", expected="a time above 0 s")


def accuracy_of(value: float) -> float:
    """An accuracy as a float: finite, above 0."""
    return positive(value, "accuracy", AccuracyError, "such as 1e-6")


class Scene:
    """A robot, its initial state and the effects that act on it. Nothing is on by default, gravity included.

    Attributes:
        robot: the robot, in the gravity field of the scene's effects (none: zero).
        q, v: the initial configuration (nq,) and velocity (nv,); neutral and at rest unless given.
        effects: the effects, in order.
        duration: seconds to simulate unless `simulate` is told otherwise.
        title: one line on what the scene shows.
        base: the robot as it was given, before the effects changed anything.
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
        for i, effect in enumerate(self.effects):
            _fits(effect, i, robot)
        self.base: Robot = robot
        self.robot: Robot = robot.changed(self._change)
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
        self._made = True

    def _change(self, model: pin.Model) -> None:
        """The robot as the effects make it: weightless unless there is gravity among them."""
        model.gravity.linear = np.zeros(3)
        for effect in self.effects:
            effect.change(model)

    def __setattr__(self, name: str, value: object) -> None:
        """Scenes do not change: what is known of one would no longer be true."""
        if "_made" in self.__dict__:
            raise SceneError("a scene cannot be changed", where=name, remedy="make another: tl.Scene(...)")
        super().__setattr__(name, value)

    def without(self, index: int) -> Scene:
        """The same scene without one of its effects."""
        return self.with_effects(self.effects[:index] + self.effects[index + 1 :])

    def with_effects(self, effects: Sequence[Effect]) -> Scene:
        """The same scene with other effects."""
        return Scene(self.base, self.q, self.v, effects, self.duration, self.title)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a .toml file that load_scene reads again; a robot of no catalogue goes beside it as a URDF."""
        from twolink.scenes.save import save_scene

        return save_scene(self, path)

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
    if sum(type(e).__name__ == "Gravity" for e in effects) > 1:
        raise SceneError("gravity is given twice", where="effects", remedy="keep one")
    return tuple(effects)


def _fits(effect: Effect, index: int, robot: Robot) -> None:
    """Require that an effect fits the robot: its joints and frames exist."""
    try:
        effect.check(robot)
    except TwolinkError as error:
        where = f"effects[{index}].{error.where}" if error.where else f"effects[{index}]"
        raise SceneError(error.what, where=where, remedy=error.remedy, argument="effects", effect=index) from None
