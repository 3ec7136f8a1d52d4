"""load_robot: a robot of a name, a file or a text, checked."""

import os
from collections.abc import Mapping, Sequence
from typing import Literal

from twolink.dynamics.robot import Robot
from twolink.robots.joint_layout import Lock
from twolink.robots.load import Policy, Purpose, Xacro, load_model


def load_robot(
    source: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    root: Literal["fixed", "free"] = "fixed",
    lock: Lock | None = None,
    gravity: Sequence[float] | None = None,
    mimic: bool = False,
    unphysical: Policy = "refuse",
    foreign: Policy = "refuse",
    purpose: Purpose = "dynamics",
    xacro: Xacro = "expand",
    xacro_arguments: Mapping[str, object] | None = None,
) -> Robot:
    """Load and check a robot. `robot.report` says what is suspicious, read, ignored, repaired and assumed.

    Parameters
    ----------
    source : str or path
        A name (`twolink robots` lists them), a path, or text: of a URDF, or of an MJCF, which MuJoCo compiles
        (twolink[mjcf]). The file may also be a xacro (twolink[xacro]).
    package_dirs : sequence of paths, optional
        Folders that package://... in mesh names counts from, and where a xacro finds packages.
    root : {"fixed", "free"}
        "fixed" to the world, or "free": a floating base with 7 more entries in q and 6 in v.
    lock : mapping of joint name to configuration, optional
        Joints to hold still, with their configuration in rad or m; they become fixed.
    gravity : sequence of float, (3,)
        The gravity field in m/s^2, along the world's axes; by default that of the MJCF, else (0, 0, -9.81).
    mimic : bool
        Couple mimic joints, for queries. Otherwise they move on their own, and the report says so. A scene couples
        them by `fx.Coupling`, as `scene_of` does.
    unphysical : {"refuse", "report"}
        Refuse bodies with inertias that no real body has, or report them and take them as they are.
    foreign : {"refuse", "report"}
        Refuse names that a URDF has not, and parts of an MJCF that change the motion and have no counterpart, such as
        springs of tendons (code "no-counterpart"); or leave them out and report them.
    purpose : {"dynamics", "kinematics", "identification"}
        Links whose inertia is missing or zero are refused for dynamics. For the others they are taken: frames,
        Jacobians and the regressor answer, dynamics is refused (code "no-inertia").
    xacro : {"expand", "ignore"}
        Expand a file that has xacro. "ignore" is for a finished URDF in which elements of xacro are left, such as
        <xacro:property>: they are left out, with all that they hold, and reported.
    xacro_arguments : mapping of str to values, optional
        Arguments of a xacro.

    Returns
    -------
    Robot

    Raises
    ------
    RobotError
        Names the file, line, link or joint, the value, and the remedy.
    """
    return load_model(
        Robot, source, package_dirs=package_dirs, root=root, lock=lock, gravity=gravity, mimic=mimic,
        unphysical=unphysical, foreign=foreign, purpose=purpose, xacro=xacro, xacro_arguments=xacro_arguments,
    )  # fmt: skip
