"""What a robot cannot do along a motion: torques beyond its limits, and links that go through each other."""

import itertools

import coal
import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot

_SHARE = 0.9  # of the torques' limits


class Reach:
    """Looks at motions of a robot. Links that overlap in the neutral configuration, and neighbours, are left out."""

    def __init__(self, robot: Robot) -> None:
        self.robot, model = robot, robot.model
        self._bodies = []
        for solid in robot.solids:
            frame = model.frames[model.getFrameId(solid.link, pin.FrameType.BODY)]
            place = frame.placement * solid.shape.placement
            self._bodies.append((solid.link, frame.parentJoint, place, solid.shape.coal()))
        self._data = model.createData()
        self._pairs = [(a, b) for a, b in itertools.combinations(range(len(self._bodies)), 2) if self._apart(a, b)]
        touching = self._touching(robot.neutral)
        self._pairs = [pair for pair in self._pairs if pair not in touching]

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> str:
        """What goes beyond it first, in words; "" where nothing does."""
        limits = np.array(self.robot.model.effortLimit)
        torques = np.abs(self.robot.regressor(q, v, a) @ self.robot.parameter_values).max(axis=0)
        for joint in self.robot.joints:
            for k in range(joint.v.start, joint.v.stop):
                if 0 < _SHARE * limits[k] < torques[k]:
                    return f"{joint.name!r} needs {torques[k]:.4g} N m or N, its limit is {limits[k]:.4g}"
        for row in q:
            if pairs := self._touching(row):
                return " and ".join(repr(self._bodies[k][0]) for k in pairs[0]) + " touch"
        return ""

    def _apart(self, first: int, second: int) -> bool:
        """Whether two bodies are at joints that are no neighbours."""
        parents, (a, b) = self.robot.model.parents, (self._bodies[k][1] for k in (first, second))
        return bool(a != b and parents[a] != b and parents[b] != a)

    def _touching(self, q: np.ndarray) -> list[tuple[int, int]]:
        pin.forwardKinematics(self.robot.model, self._data, q)
        places = [self._data.oMi[joint] * placement for _, joint, placement, _ in self._bodies]
        poses = [coal.Transform3s(place.rotation, place.translation) for place in places]
        request, bodies = (
            coal.CollisionRequest(),
            [(body[3], pose) for body, pose in zip(self._bodies, poses, strict=True)],
        )
        return [(a, b) for a, b in self._pairs if coal.collide(*bodies[a], *bodies[b], request, coal.CollisionResult())]
