"""Rotors of motors behind gears."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.effect import Effect, one_of
from twolink.effects.joint_checks import check_joints, check_values


class Rotor(Effect, frozen=True):
    """The inertia N^2 J of a motor's rotor, turning N times as fast as its joint, added to the joint's own (armature).

    What a rotor gives by being carried along and turned with its link (its mass, and its gyroscopic moment, of the
    order 1 / N of this) is not in it: count its mass to the link.

    inertia: J by joint, kg m^2; for a joint that slides and a rotor that turns N rad a metre, kg m^2 as well. ratio: N
    by joint; 1 unless given.
    """

    inertia: Mapping[str, float]
    ratio: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Names are joints of one degree of freedom; inertias are not negative."""
        check_joints(self.inertia, robot, "inertia", dofs=True)
        check_values(self.inertia, "inertia", least=0.0)
        for joint in self.ratio:
            one_of(joint, self.inertia, "ratio", "joint with a rotor")
        check_values(self.ratio, "ratio")

    def change(self, model: pin.Model) -> None:
        """N^2 J in the model's armature."""
        armature = np.array(model.armature)
        for joint, inertia in self.inertia.items():
            armature[model.idx_vs[model.getJointId(joint)]] += float(self.ratio.get(joint, 1.0)) ** 2 * inertia
        model.armature = armature
