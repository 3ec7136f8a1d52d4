"""Checks of a log's numbers for rad, m and s: rates against velocities, ranges against limits."""

from collections.abc import Mapping

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import QueryError
from twolink.robots.joint_layout import JointLayout

DEGREE = float(np.pi / 180)
# By a ratio: the question, and the quantity, "" for the one that is odd itself, and the factor that would mend it.
Guesses = Mapping[float, tuple[str, str, float | None]]
LIKELY: Guesses = {
    1 / DEGREE: ("is v in degrees?", "v", DEGREE),
    DEGREE: ("is q in degrees?", "q", DEGREE),
    1e3: ("is t in milliseconds?", "t", 1e-3),
}
_UNITS = {("q", DEGREE): "np.radians(q), --units deg", ("t", 1e-3): "t / 1000, --units ms"}


def remedy_of(column: str, factor: float) -> str:
    """The remedy that gives a column in SI units, with text that can be pasted."""
    ways = _UNITS.get((column.partition(".")[0], factor), f"{factor:.6g} times it")
    entry = f'{column} = {{column = "...", scale = {factor:.6g}}}'
    return f"give {column} in SI units: {ways}, or {entry} in a map of columns"


def range_of(robot: Robot, q: np.ndarray, joint: JointLayout) -> str:
    """A joint's column and the range of its values, in words."""
    angles = q[:, joint.q.start] if joint.kind == "vector" else robot.difference(q[:1], q)[:, joint.v.start]
    return f"q.{joint.name} goes from {angles.min():.4g} to {angles.max():.4g}"


def check_units(robot: Robot, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
    """Refuse velocities that are a multiple of the rate of the positions. Raises QueryError (code "units")."""
    moved = robot.difference(q[:-1], q[1:])
    expected = (v[1:] + v[:-1]) / 2 * np.diff(t)[:, None]
    for joint in robot.joints:
        x, y = moved[:, joint.v].ravel(), expected[:, joint.v].ravel()
        alike = abs(x @ y) / max(np.linalg.norm(x) * np.linalg.norm(y), 1e-300)
        ratio = float(x @ y / max(x @ x, 1e-300))
        if alike > 0.9 and not 1 / 3 < abs(ratio) < 3:
            what = f"v of joint {joint.name!r} is {ratio:.4g} times the rate of its q"
            if joint.v.stop - joint.v.start == 1:
                what = f"{range_of(robot, q, joint)}, and {what}"
            raise wrong_units(what, "v", ratio, f"v.{joint.name}")


def wrong_units(what: str, argument: str, ratio: float, column: str, guesses: Guesses = LIKELY) -> QueryError:
    """The error for a column v.JOINT or the like that is `ratio` times what it must be, with a guess at the reason."""
    guess, remedy, (own, _, joint) = "", "give rad, m and s throughout", column.partition(".")
    for scale, (question, letter, factor) in guesses.items():
        if abs(np.log(abs(ratio) / scale)) < 0.1:
            guess = f"; {question}"
            if factor is not None:
                remedy = remedy_of("t" if letter == "t" else f"{letter or own}.{joint}", factor)
    return QueryError(what + guess, argument=argument, remedy=remedy, code="units")


def wide_joint(robot: Robot, q: np.ndarray) -> JointLayout | None:
    """The joint that turns farthest, where it does more than a turn or leaves limits that hold it as degrees."""
    turning = [joint for joint in robot.joints if joint.kind == "vector" and joint.unit == "rad"]
    far = [float(np.abs(q[:, joint.q.start]).max(initial=0.0)) for joint in turning]
    wide = [(angle, k) for k, (joint, angle) in enumerate(zip(turning, far, strict=True))
            if angle > 2 * np.pi or angle * DEGREE < _reach(joint) < angle / 1.5]  # fmt: skip
    return turning[max(wide)[1]] if wide else None


def _reach(joint: JointLayout) -> float:
    """The limit of a joint's |q|, rad; infinite where there is none."""
    return max(map(abs, (*joint.lower, *joint.upper)))


def in_degrees(robot: Robot, q: np.ndarray, joint: JointLayout, why: str) -> QueryError:
    """The error for angles in degrees; the joint that shows it, and why it does."""
    return QueryError(f"{range_of(robot, q, joint)}, {why}; is q in degrees?", argument="q", code="units",
                      remedy=remedy_of(f"q.{joint.name}", DEGREE))  # fmt: skip


def beyond_reach(robot: Robot, t: np.ndarray, q: np.ndarray) -> tuple[JointLayout, str] | None:
    """A joint whose angle and speed are beyond its limits and within them as degrees, and that in words."""
    speed = np.abs(robot.difference(q[:-1], q[1:]) / np.diff(t)[:, None]).max(axis=0, initial=0.0)
    for joint in robot.joints:
        if joint.kind != "vector" or joint.unit != "rad":
            continue
        fastest, limit = float(speed[joint.v.start]), float(robot.model.velocityLimit[joint.v.start])
        reach, far = _reach(joint), float(np.abs(q[:, joint.q.start]).max())
        if far * DEGREE < reach < far / 1.5 and fastest * DEGREE < limit < fastest:
            return joint, f"at up to {fastest:.4g} rad/s; its limits are {reach:.4g} rad and {limit:.4g} rad/s"
    return None
