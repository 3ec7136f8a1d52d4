"""A body fixed to a link."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.effect import Effect, finite
from twolink.effects.frame_checks import check_frame, check_three
from twolink.errors import SceneError
from twolink.robots.physical_checks import semidefinite_defect, triangle_excess


class Payload(Effect, frozen=True):
    """A rigid body that moves with a frame from the start: its inertia is added to the link's.

    frame: a link. mass: kg. com: its centre of mass in the frame, m. inertia: (xx, xy, xz, yy, yz, zz) about the
    centre of mass, along the frame's axes, kg m^2; a point mass unless given.
    """

    frame: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6

    def check(self, robot: Robot) -> None:
        """The frame moves; mass and inertia are a real body's."""
        check_frame(self.frame, robot, "frame")
        finite(self.mass, "mass", least=0.0)
        check_three(self.com, "com")
        finite(self.inertia, "inertia")
        if len(self.inertia) != 6:
            raise SceneError(f"expected 6 numbers, got {len(self.inertia)}", where="inertia",
                             remedy="give (xx, xy, xz, yy, yz, zz)")  # fmt: skip
        matrix, mass = _matrix(self.inertia), float(self.mass)
        if semidefinite_defect(matrix, mass) < 0 or triangle_excess(matrix, mass) > 0 or (not mass and matrix.any()):
            raise SceneError(f"no body has the inertia {list(self.inertia)} with {mass:g} kg", where="inertia",
                             remedy="give it about the centre of mass, as (xx, xy, xz, yy, yz, zz)")  # fmt: skip

    def change(self, model: pin.Model) -> None:
        """The sum of both bodies in the model."""
        frame = model.frames[model.getFrameId(self.frame, pin.FrameType.BODY)]
        body = pin.Inertia(float(self.mass), np.array(self.com, dtype=float), _matrix(self.inertia))
        model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint] + frame.placement.act(body)


def _matrix(inertia: tuple[float, ...]) -> np.ndarray:
    xx, xy, xz, yy, yz, zz = map(float, inertia)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
