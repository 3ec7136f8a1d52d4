"""Other values of the robot's physical constants."""

from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import body_names, moments, parameter_names, with_nominal
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, check_name, finite
from twolink.errors import SceneError

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
            principal, parts = np.linalg.eigvalsh(body.inertia), ("inertia", "origin_inertia", "first_moment")
            if principal[0] < -ROUNDING * principal[-1] and any(
                name.startswith(tuple(f"{link}.{part}." for part in parts)) for name in self.values
            ):
                numbers = ", ".join(f"{moment:.6g}" for moment in principal)
                what = f"no body has principal moments of inertia of {numbers} kg m^2"
                raise SceneError(what, where=f"values.{link}.inertia", remedy="give those of a real body",
                                 code="impossible-body")  # fmt: skip
