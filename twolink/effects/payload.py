"""A body fixed to a link."""

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.effect import Effect, LinkName, NotNegative
from twolink.effects.frame_checks import check_frame
from twolink.errors import SceneError
from twolink.robots.physical_checks import is_impossible


class Payload(Effect, frozen=True):
    """A rigid body fixed to a link from the start: its inertia is added to the link's.

    Parameters
    ----------
    frame : str
        The link.
    mass : float
        kg.
    com : (3,) floats
        The body's centre of mass in the link's frame, m.
    inertia : (6,) floats
        (xx, xy, xz, yy, yz, zz) about the body's centre of mass, along the link's axes, kg m^2; 0 for a point mass.
    """

    frame: LinkName
    mass: NotNegative
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6

    def check(self, robot: Robot) -> None:
        """Require a link that moves, and a mass and an inertia that a body can have."""
        check_frame(self.frame, robot, "frame")
        matrix, mass = _matrix(self.inertia), float(self.mass)
        if is_impossible(matrix, mass) or (not mass and matrix.any()):
            what = f"no body has the inertia {list(self.inertia)} with {mass:g} kg"
            remedy = "give it about the centre of mass, as (xx, xy, xz, yy, yz, zz)"
            raise SceneError(what, where="inertia", remedy=remedy)

    def change(self, model: pin.Model) -> None:
        """Put the sum of both bodies into the model."""
        frame = model.frames[model.getFrameId(self.frame, pin.FrameType.BODY)]
        body = pin.Inertia(float(self.mass), np.array(self.com, dtype=float), _matrix(self.inertia))
        model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint] + frame.placement.act(body)


def _matrix(inertia: tuple[float, ...]) -> np.ndarray:
    """The symmetric matrix (3, 3) of (xx, xy, xz, yy, yz, zz)."""
    xx, xy, xz, yy, yz, zz = map(float, inertia)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
