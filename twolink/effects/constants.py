"""Physical constants that a scene changes: gravity, payloads, rotors, and any by name."""

import math
from collections.abc import Mapping
from numbers import Real
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import body_names, moments, parameter_names, with_nominal
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, LinkName, NotNegative, SingleJoint, check_name, finite, of
from twolink.errors import SceneError
from twolink.robots.checks import is_impossible
from twolink.robots.suspicions import too_heavy


class Gravity(Effect, frozen=True):
    """A uniform gravity field g: each body of mass m feels the force m g at its centre of mass.

    Parameters
    ----------
    field : (3,) floats
        g, m/s^2, along the world's axes; z points up.
    """

    field: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        three = isinstance(self.field, (tuple, list, np.ndarray)) and len(self.field) == 3
        if not (three and all(isinstance(g, Real) and math.isfinite(g) for g in self.field)):
            remedy = "give m/s^2, such as (0, 0, -9.81)"
            raise SceneError(f"expected 3 finite numbers, got {self.field!r:.60}", where="gravity.field", remedy=remedy)

    def change(self, model: pin.Model) -> None:
        """Set the model's field, which every query then uses."""
        model.gravity.linear = np.array(self.field)


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
        """Require a mass and an inertia that a body can have."""
        del robot
        matrix, mass = _matrix(self.inertia), float(self.mass)
        if is_impossible(matrix, mass):
            what = f"no body has the inertia {list(self.inertia)} with {mass:g} kg"
            remedy = "give it about the centre of mass, as (xx, xy, xz, yy, yz, zz)"
            raise SceneError(what, where="inertia", remedy=remedy)

    def notes(self, robot: Robot) -> list[str]:
        """A mass out of proportion to the robot's (`robots.suspicions`)."""
        what = too_heavy(float(self.mass), robot.mass - float(self.mass))
        return [f"suspicious: the payload on {self.frame!r} is {what}"] if what else []

    def change(self, model: pin.Model) -> None:
        """Put the sum of both bodies into the model."""
        frame = model.frames[model.getFrameId(self.frame, pin.FrameType.BODY)]
        body = pin.Inertia(float(self.mass), np.array(self.com, dtype=float), np.zeros((3, 3)))
        body.inertia = _matrix(self.inertia)  # unchecked: derivatives move the entries of a point mass from 0
        model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint] + frame.placement.act(body)


def _matrix(inertia: tuple[float, ...]) -> np.ndarray:
    """The symmetric matrix (3, 3) of (xx, xy, xz, yy, yz, zz)."""
    xx, xy, xz, yy, yz, zz = map(float, inertia)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Rotor(Effect, frozen=True):
    """Inertia of motors behind gears: N^2 J is added to the joint's inertia (its armature).

    Parameters
    ----------
    inertia : mapping of joint to float
        J of the rotor, kg m^2, not negative. Joints with one degree of freedom, turning or sliding.
    ratio : mapping of joint to float
        N, turns of the rotor per turn of the joint, or rad per metre of a joint that slides; 1 by default.

    Notes
    -----
    Two effects of a rotor that its link carries are left out: its mass, which counts to the link, and its gyroscopic
    moment, which is smaller by about 1 / N.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 7.1.1.
    """

    inertia: Mapping[SingleJoint, NotNegative]
    ratio: Annotated[Mapping[str, float], of("inertia")] = {}

    def change(self, model: pin.Model) -> None:
        """Add N^2 J to the model's armature."""
        armature = np.array(model.armature)
        for joint, inertia in self.inertia.items():
            armature[model.idx_vs[model.getJointId(joint)]] += float(self.ratio.get(joint, 1.0)) ** 2 * inertia
        model.armature = armature


_DAMPING = ".damping"
ROUNDING = 1e-12  # relative


class Constants(Effect, frozen=True):
    """Other values of physical constants, such as those that were found in measurements; after earlier effects.

    Parameters
    ----------
    values : mapping of str to float
        By name, SI units: LINK.mass, LINK.com.x|y|z, LINK.inertia.xx|xy|xz|yy|yz|zz (about the centre of mass),
        JOINT.origin.x|y|z, JOINT.armature, gravity.x|y|z (`algorithms.mechanism.parameter_names`); after these, about
        the joint, LINK.first_moment.x|y|z and LINK.origin_inertia.xx|xy|yy|xz|yz|zz. A link has the value that is
        written here also where an earlier payload changed it, but not what is released later.
    """

    values: Annotated[
        Mapping[str, float], msgspec.Meta(extra_json_schema={"propertyNames": {"type": "string", "format": "constant"}})
    ]

    def check(self, robot: Robot) -> None:
        """Require names of constants that forward dynamics uses, and masses and armatures that are not negative."""
        known = [name for name in parameter_names(robot.model) if not name.endswith(_DAMPING)] + [*moments(robot.model)]
        for name in map(str, self.values):
            if name.endswith(_DAMPING):
                raise SceneError("damping acts as an effect", where=f"values.{name}", remedy="use joint-damping")
            check_name(name, known, "values", "constant")
            if name.endswith((".mass", ".armature")):
                finite(self.values[name], f"values.{name}", least=0.0)

    def change(self, model: pin.Model) -> None:
        """Set them in the model. Raises SceneError, code "impossible-body"."""
        of_origin = moments(model)
        for name in sorted(self.values, key=lambda name: name in of_origin):
            with_nominal(model, name, float(self.values[name]))
        for body, link in zip(model.inertias, body_names(model), strict=True):
            principal = np.linalg.eigvalsh(body.inertia)
            parts, remedy = ["inertia", "origin_inertia", "first_moment"], "give those of a real body"
            if body.mass <= 0 < principal[-1]:
                parts, remedy = ["mass", *parts], "give a mass above 0, or moments of 0"
            elif principal[0] >= -ROUNDING * principal[-1]:
                continue
            if any(name.startswith(tuple(f"{link}.{part}" for part in parts)) for name in self.values):
                numbers = ", ".join(f"{moment:.6g}" for moment in principal)
                what = f"no body has principal moments of inertia of {numbers} kg m^2 with {body.mass:g} kg"
                raise SceneError(what, where=f"values.{link}.{parts[0]}", remedy=remedy, code="impossible-body")
