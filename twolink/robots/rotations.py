"""Rotations of a URDF's <origin>: roll, pitch and yaw, or a quaternion, which becomes roll, pitch and yaw."""

from __future__ import annotations

import math

import numpy as np

from twolink.robots.xml import Element, Reader

UNIT_TOLERANCE = 1e-3  # files write quaternions with few digits


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """R = Rz(yaw) Ry(pitch) Rx(roll), URDF's convention, (3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(x), math.sin(x)) for x in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """The angles [rad] of a quaternion of any length; `rotation` of them is its matrix, at pitch = 90 degrees too.

    The yaw is read after the roll was taken out of the matrix: at pitch = 90 degrees only their sum is defined, and
    the yaw makes up for any error of the roll.
    """
    n = x * x + y * y + z * z + w * w
    s = 2 / n
    r00, r01, r02 = 1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)
    r10, r11, r12 = s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)
    r20, r21, r22 = s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)
    roll = math.atan2(r21, r22)
    c, s = math.cos(roll), math.sin(roll)
    return roll, math.atan2(-r20, math.hypot(r00, r10)), math.atan2(s * r02 - c * r01, c * r11 - s * r12)


def quaternions_to_angles(reader: Reader, owner: Element, name: str) -> None:
    """Replace quat_xyzw in the origins inside a link or joint by rpy, which every reader below knows.

    Raises
    ------
    RobotError
        The origin has rpy as well, or the quaternion's length is not 1.
    """
    for element in owner.children:
        if element.tag != "origin":
            quaternions_to_angles(reader, element, name)
        elif "quat_xyzw" in element.attributes:
            if "rpy" in element.attributes:
                raise reader.error(element, name, "<origin> has both rpy and quat_xyzw", "keep one")
            quaternion = reader.numbers(element, "quat_xyzw", name, 4)
            length = math.hypot(*quaternion)
            if abs(length - 1) > UNIT_TOLERANCE:
                what = f"quat_xyzw has length {length:.6g}, expected 1"
                raise reader.error(element, name, what, "divide it by its length")
            del element.attributes["quat_xyzw"]
            element.attributes["rpy"] = " ".join(map(repr, roll_pitch_yaw(*quaternion)))
