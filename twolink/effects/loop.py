"""Loops: what keeps two places of a robot together, besides its joints. A constraint g(q) = 0."""

from __future__ import annotations

from typing import ClassVar

import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.spatial import Scalar
from twolink.effects.effect import Effect, one_of
from twolink.effects.motion import GROUND, Motion


class Loop(Effect, frozen=True):
    """A bilateral, rigid constraint: g(q) = 0 holds for ever, by whatever forces that takes (J^T lambda).

    Rows that say what others say already are found and dropped: give the whole joint, planar or not.
    """

    formulation: ClassVar[str] = "loops"

    def rows(self, motion: Motion) -> list[Scalar]:
        """g(q), m and (of directions) 1."""
        raise NotImplementedError


def require_frame(robot: Robot, frame: str, field: str) -> None:
    """Require that a frame is a link's, or the ground. Raises SceneError with the nearest name."""
    names = [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY]
    one_of(frame, [*names, GROUND], field, "link")
