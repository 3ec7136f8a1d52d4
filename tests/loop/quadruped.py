"""A Solo12 on its feet above the ground, and the law of its joints."""

from typing import Any

import numpy as np

import twolink as tl

E = tl.effects
RADIUS = 0.0165  # m, of a foot
KP, KD = 5.0, 0.1
_BENT = {"HAA": 0.0, "HFE": 0.8, "KFE": -1.6}
TARGET = {f"{leg}_{joint}": angle * (-1.0 if leg[0] == "H" else 1.0)
          for leg in ("FL", "FR", "HL", "HR") for joint, angle in _BENT.items()}  # fmt: skip


def quadruped(height: float = 0.01) -> tuple[tl.Scene, Any]:
    """The scene without a controller, its feet at a height above the ground [m]; and the law, (t, y, state)."""
    robot = tl.load_robot("solo12", root="free")
    q = robot.neutral
    for joint in robot.joints[1:]:
        q[joint.q] = TARGET[joint.name]
    feet = [name for name in robot.frame_names if name.endswith("FOOT")]
    q[2] = height + RADIUS - min(float(robot.frame_pose(q, foot)[1][2]) for foot in feet)
    shapes = {foot: (E.Sphere(RADIUS),) for foot in feet}
    ground = E.Contact(tuple((foot, "ground") for foot in feet), 0.6, shapes=shapes)
    aim = np.array([TARGET[joint.name] for joint in robot.joints[1:]])

    def law(_: float, y: Any, state: Any) -> tuple[np.ndarray, Any]:
        return KP * (aim - y.q[7:]) - KD * y.v[6:], state

    return tl.Scene(robot, q, effects=[E.Gravity(), ground]), law
