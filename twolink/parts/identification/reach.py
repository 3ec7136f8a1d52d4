"""Motions beyond a robot's reach: torques beyond its limits, and links that go through each other."""

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.contact_pairs import SELF, select_pairs
from twolink.errors import SceneError
from twolink.robots.collisions import Solid, collision_model

_SHARE = 0.9  # of the torques' limits
_CLOSE = 1e-4  # m: links that are nearer in the neutral configuration touch always


class Reach:
    """Looks at motions of a robot. Neighbours, and what an SRDF or rest in the neutral configuration excuses, pass."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self._links = robot, list[tuple[str, str]]()
        self._geometry = collision_model(robot.model, robot.solids)
        numbers = {id(solid): k for k, solid in enumerate(robot.solids)}
        try:
            chosen = select_pairs(robot, robot.solids, [SELF], _CLOSE).chosen
            pairs = [(a, b) for _, a, b in chosen if isinstance(b, Solid)]
        except SceneError:  # it has no shapes, or none that meet
            pairs = []
        for a, b in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(numbers[id(a)], numbers[id(b)]))
            self._links.append((a.link, b.link))
        self._data, self._seen = robot.model.createData(), pin.GeometryData(self._geometry)

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[str, np.ndarray]:
        """The first violation, in words, and the degrees of freedom (nv,) that matter; "" where there is none."""
        limits = np.array(self.robot.model.effortLimit)
        torques = np.abs(self.robot.regressor(q, v, a) @ self.robot.parameter_values).max(axis=0)
        for joint in self.robot.joints:
            for k in range(joint.v.start, joint.v.stop):
                if 0 < _SHARE * limits[k] < torques[k]:
                    what = f"{joint.name!r} needs {torques[k]:.4g} N m or N, its limit is {limits[k]:.4g}"
                    return what, np.ones(self.robot.nv, dtype=bool)
        for row in q:
            if pin.computeCollisions(self.robot.model, self._data, self._geometry, self._seen, row, True):
                touch = [result.isCollision() for result in self._seen.collisionResults].index(True)
                return " and ".join(map(repr, self._links[touch])) + " touch", self._between(touch)
        return "", np.zeros(self.robot.nv, dtype=bool)

    def _between(self, pair: int) -> np.ndarray:
        """The degrees of freedom (nv,) that move the links of a pair against each other."""
        model, both = self.robot.model, self._geometry.collisionPairs[pair]
        parents = [self._geometry.geometryObjects[k].parentJoint for k in (both.first, both.second)]
        moving = set(model.supports[parents[0]]) ^ set(model.supports[parents[1]])
        own = [range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in moving]
        return np.isin(np.arange(model.nv), [k for dofs in own for k in dofs])
