"""Rotors of motors behind gears."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative
from twolink.effects.joint_checks import check_joints, check_subset


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

    inertia: Mapping[str, NotNegative]
    ratio: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Require joints of one degree of freedom."""
        check_joints(self.inertia, robot, "inertia", dofs=True)
        check_subset(self.ratio, self.inertia, "ratio", "joint with a rotor")

    def change(self, model: pin.Model) -> None:
        """Add N^2 J to the model's armature."""
        armature = np.array(model.armature)
        for joint, inertia in self.inertia.items():
            armature[model.idx_vs[model.getJointId(joint)]] += float(self.ratio.get(joint, 1.0)) ** 2 * inertia
        model.armature = armature
