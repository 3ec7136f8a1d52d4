"""The robot in motion: where its joints and frames are and how they move. Over plain arithmetic."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import pinocchio as pin

from twolink.algorithms import spatial as sp
from twolink.algorithms.functions import frame_pose
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import STILL, poses
from twolink.algorithms.spatial import AT_PARENT, ZERO, Pose, Scalar, Scalars, Spatial, Vec

T = TypeVar("T")
GROUND = "universe"  # the world, whose points are given in its coordinates; Pinocchio's name for it


class KinematicState:
    """A kinematic state of a robot: q (nq), v (nv) and the time t, as numbers, arrays of a batch, or expressions.

    mech: the robot's constants. xp: the namespace of sin, cos, sqrt, exp, tanh, where, less. states: those of effects,
    by name. links: the motion of the robot itself, where this is one of its motors (`driven_by`). What is asked for is
    computed once; what is not asked for leaves no operation behind.
    """

    def __init__(
        self,
        model: pin.Model,
        mech: Mechanism,
        q: Scalars,
        v: Scalars,
        t: Scalar,
        xp: Any,
        states: Mapping[str, Scalar] | None = None,
    ) -> None:
        self.model, self.mech, self.q, self.v, self.t, self.xp = model, mech, q, v, t, xp
        self.states, self.links = states or {}, self
        self._own: list[Pose] | None = None
        self._world: dict[int, Pose] = {0: AT_PARENT}
        self._velocity: dict[int, Spatial] = {0: STILL}
        self._known: dict[Any, Any] = {}  # of places alone

    def frame(self, frame: str) -> tuple[int, Pose]:
        """The body that carries a frame, and where it sits there; the ground is body 0."""
        if frame not in self._known:
            ground = frame == GROUND and not self.model.existBodyName(GROUND)
            self._known[frame] = (0, AT_PARENT) if ground else frame_pose(self.model, frame)
        found: tuple[int, Pose] = self._known[frame]
        return found

    def once(self, formula: Callable[[Any], T]) -> T:
        """A method of some object that takes a motion and depends on places alone, evaluated when it is first met."""
        if formula not in self._known:
            self._known[formula] = formula(self)
        value: T = self._known[formula]
        return value

    def with_velocity(self, v: Scalars) -> KinematicState:
        """A motion at the same places with another velocity."""
        self.own()
        other = copy.copy(self)
        other.v, other.links, other._velocity = v, other, {0: STILL}
        return other

    def carrier(self, *frames: str) -> int:
        """The nearest body that carries all of these frames; 0 is the ground."""
        supports = [[*self.mech.support(self.frame(frame)[0]), 0] for frame in frames]
        return next(i for i in supports[0] if all(i in support for support in supports))

    def seen_from(self, body: int) -> KinematicState:
        """The motion relative to a body, for it and what it carries; the joints that carry it do not change that."""
        if body == 0:
            return self
        seen = KinematicState(self.model, self.mech, self.q, self.v, self.t, self.xp)
        seen._own, seen._world, seen._velocity = self.own(), {body: AT_PARENT}, {body: STILL}
        return seen

    def driven_by(self, motors: Mapping[str, tuple[Scalar, Scalar]]) -> KinematicState:
        """The motion of motors in the place of joints of one coordinate: by joint the motor's angle and its speed."""
        seen = copy.copy(self)
        seen.q, seen.v, seen._own, seen._world = list(self.q), list(self.v), None, {0: AT_PARENT}
        seen._velocity, seen._known = {0: STILL}, {}
        for joint, (angle, speed) in motors.items():
            entry, dof = self.coordinate(joint)
            seen.q[entry], seen.v[dof] = angle, speed
        return seen

    def own(self) -> list[Pose]:
        """Each body's pose in its parent."""
        if self._own is None:
            self._own = poses(self.mech, self.q, self.xp)
        return self._own

    def body(self, i: int) -> Pose:
        """The pose of body i in the world."""
        if i not in self._world:
            self._world[i] = sp.single_turn(sp.compose(self.body(self.mech.parents[i]), self.own()[i]))
        return self._world[i]

    def body_velocity(self, i: int) -> Spatial:
        """(linear, angular) velocity of body i at its joint's origin, along its own axes."""
        if i not in self._velocity:
            before = sp.motion_to_child(self.own()[i], self.body_velocity(self.mech.parents[i]))
            self._velocity[i] = sp.spatial_add(before, self.mech.joints[i].motion(self.v))
        return self._velocity[i]

    def position(self, frame: str, point: Vec = ZERO) -> Vec:
        """Position of a point of the frame in the world, m."""
        i, place = self.frame(frame)
        return placed(self.body(i), placed(place, point))

    def direction(self, frame: str, axis: Vec) -> Vec:
        """A direction that is fixed in the frame, along the world's axes."""
        i, place = self.frame(frame)
        return sp.outward(self.body(i), sp.outward(place, axis))

    def velocity(self, frame: str, point: Vec = ZERO) -> Vec:
        """The velocity of a point of the frame, along the world's axes, m/s."""
        i, place = self.frame(frame)
        linear, angular = self.body_velocity(i)
        return sp.outward(self.body(i), sp.add(linear, sp.cross(angular, placed(place, point))))

    def angular_velocity(self, frame: str) -> Vec:
        """The angular velocity of the frame's body, along the world's axes, rad/s."""
        i, _ = self.frame(frame)
        return sp.outward(self.body(i), self.body_velocity(i)[1])

    def coordinate(self, joint: str) -> tuple[int, int]:
        """The entries of q and v that belong to a joint with one of each: an angle or a length."""
        i = self.model.getJointId(joint)
        return self.model.idx_qs[i], self.model.idx_vs[i]

    def dofs(self, joint: str) -> range:
        """The entries of v that belong to a joint."""
        i = self.model.getJointId(joint)
        return range(self.model.idx_vs[i], self.model.idx_vs[i] + self.model.nvs[i])


def placed(pose: Pose, point: Vec) -> Vec:
    """R x + r."""
    return sp.add(pose.origin, sp.outward(pose, point))
