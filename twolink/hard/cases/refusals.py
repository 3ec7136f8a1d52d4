"""Wrong input of every kind: a named error must be raised before any NaN appears."""

import functools
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from twolink import effects as fx
from twolink.dynamics import load_robot
from twolink.errors import AccuracyError, QueryError, RobotError, SceneError, TwolinkError
from twolink.hard.case import FOLDER, ErrorCheck
from twolink.integrate.steps.methods import METHODS
from twolink.scenes import Scene
from twolink.simulation import simulate_many
from twolink.simulation.scene_run import simulate
from twolink.simulation.time_limit import TimeLimit

BAD = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
GRAVITY = fx.Gravity()
HANG = 15.0  # s of computing

_MASSLESS = """<robot name="r"><link name="base"/><link name="{name}">{inertial}</link>
<joint name="j" type="{kind}"><parent link="base"/><child link="{name}"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>{more}</robot>"""
_SOLID = """<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
_POINT = """<inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>"""
_LEAF = """<link name="light"/><joint name="k" type="revolute"><parent link="heavy"/><child link="light"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"""
_BODY = """<robot name="r"><link name="base"/><link name="body">
<inertial><origin xyz="{com} 0 0"/><mass value="{mass}"/>
<inertia ixx="{ixx}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="body"/><origin xyz="{xyz} 0 0"/>
<axis xyz="0 {axis} 0"/><limit lower="{lower}" upper="9" effort="9" velocity="9"/></joint></robot>"""
_SOUND = {"com": "0", "mass": "1", "ixx": "1", "xyz": "0", "axis": "1", "lower": "-9"}


def _arm(*effects: Any, q: Any = None, v: Any = None) -> Scene:
    return Scene(load_robot("two_link"), q, v, [GRAVITY, *effects], 1.0)


def _run(*effects: Any, **options: Any) -> object:
    return simulate(_arm(*effects), progress=TimeLimit(HANG, time.process_time), **options)


def _massless(name: str, kind: str = "revolute", inertial: str = "", more: str = "") -> Callable[[], object]:
    return lambda: load_robot(_MASSLESS.format(name=name, kind=kind, inertial=inertial, more=more))


def _each(calls: Mapping[str, Callable[[float], object]], kind: Any) -> dict[str, ErrorCheck]:
    """Every call with NaN, inf and -inf."""
    return {
        f"{what} = {bad}": ErrorCheck(functools.partial(call, number), kind)
        for what, call in calls.items()
        for bad, number in BAD.items()
    }


_ROBOT_NUMBERS: dict[str, Callable[[float], object]] = {
    f"URDF {field}": functools.partial(lambda field, x: load_robot(_BODY.format(**{**_SOUND, field: repr(x)})), field)
    for field in _SOUND
}
_STATES: dict[str, Callable[[float], object]] = {
    "q of a scene": lambda x: _arm(q=[x, 0.0]),
    "v of a scene": lambda x: _arm(v=[x, 0.0]),
    "q of simulate_many": lambda x: simulate_many(_arm(), q=[[x, 0.0]]),
    "v of simulate_many": lambda x: simulate_many(_arm(), v=[[x, 0.0]]),
    "forward dynamics q": lambda x: load_robot("two_link").forward_dynamics([x, 0], [0, 0], [0, 0]),
    "forward dynamics v": lambda x: load_robot("two_link").forward_dynamics([0, 0], [x, 0], [0, 0]),
    "forward dynamics tau": lambda x: load_robot("two_link").forward_dynamics([0, 0], [0, 0], [x, 0]),
    "inverse dynamics a": lambda x: load_robot("two_link").inverse_dynamics([0, 0], [0, 0], [x, 0]),
    "mass matrix q": lambda x: load_robot("two_link").mass_matrix([x, 0]),
    "energy v": lambda x: load_robot("two_link").energy([0, 0], [x, 0]),
    "external wrench": lambda x: load_robot("two_link").forward_dynamics(
        [0, 0], [0, 0], [0, 0], f_ext={"forearm": [x, 0, 0, 0, 0, 0]}),
    "gravity of a robot": lambda x: load_robot("two_link", gravity=(0, 0, x)),
}  # fmt: skip
_SETTINGS: dict[str, Callable[[float], object]] = {
    "duration": lambda x: _run(duration=x),
    "accuracy": lambda x: _run(accuracy=x),
    "samples_per_second": lambda x: _run(samples_per_second=x),
    "t_eval": lambda x: _run(t_eval=[0.0, x]),
    "tolerance": lambda x: _run(method="dop853", tolerance=x),
    "step": lambda x: _run(method="rk4", step=x),
    "duration of a scene": lambda x: Scene(load_robot("two_link"), duration=x),
    "duration of simulate_many": lambda x: simulate_many(_arm(), duration=x),
    "parameter of simulate_many": lambda x: simulate_many(_arm(), parameters={"forearm.mass": x}),
}
_EFFECTS: dict[str, Callable[[float], object]] = {
    "gravity": lambda x: Scene(load_robot("two_link"), effects=[fx.Gravity((0.0, 0.0, x))]),
    "torque": lambda x: _arm(fx.Torque({"elbow": x})),
    "torque's sine": lambda x: _arm(fx.Torque({"elbow": fx.Sine(amplitude=1.0, frequency=x)})),
    "torque's polynomial": lambda x: _arm(fx.Torque({"elbow": fx.Polynomial((0.0, x))})),
    "torque's table": lambda x: _arm(fx.Torque({"elbow": fx.Sampled((0.0, 1.0), (x, 0.0))})),
    "table's times": lambda x: _arm(fx.Torque({"elbow": fx.Sampled((0.0, x), (1.0, 0.0))})),
    "spring": lambda x: _arm(fx.JointSpring({"elbow": x})),
    "spring's rest": lambda x: _arm(fx.JointSpring({"elbow": 1.0}, {"elbow": x})),
    "damper": lambda x: _arm(fx.JointDamping({"elbow": x})),
    "smooth friction": lambda x: _arm(fx.SmoothFriction({"elbow": x}, 0.1)),
    "wrench": lambda x: _arm(fx.FrameWrench("forearm", (x, 0.0, 0.0))),
    "spring between": lambda x: _arm(fx.SpringBetween("forearm", "universe", stiffness=x)),
    "point loop": lambda x: _arm(fx.PointLoop("forearm", point_a=(x, 0.0, 0.0))),
    "hinge loop": lambda x: _arm(fx.HingeLoop("forearm", (0.0, x, 0.0), (0.0, 1.0, 0.0))),
    "weld loop": lambda x: _arm(fx.WeldLoop("forearm", rpy=(x, 0.0, 0.0))),
    "coupling": lambda x: _arm(fx.Coupling("elbow", "shoulder", x)),
    "rotor": lambda x: _arm(fx.Rotor({"elbow": x})),
}


def _four_bar(point: float) -> object:
    """The parallelogram, whose coupler is to reach a point at this distance [m]."""
    robot = load_robot(str(FOLDER / "parallelogram.urdf"))
    loop = fx.PointLoop("coupler", "universe", (1.0, 0.0, 0.0), (point, 0.0, 0.0))
    return simulate(Scene(robot, [1.5, -1.5, 1.5], effects=[GRAVITY, loop]), 1.0)


def _contradiction() -> object:
    """One point held at two places."""
    robot = load_robot("two_link")
    loops = [fx.PointLoop("forearm", point_a=(1.0, 0.0, 0.0), point_b=(x, 0.0, 0.0)) for x in (1.0, 1.1)]
    return simulate(Scene(robot, [0.3, -0.5], effects=[GRAVITY, *loops]), 1.0)


def _durations() -> dict[str, ErrorCheck]:
    calls: dict[str, ErrorCheck] = {}
    for number in (0, 0.0, -0.0, -1.0, -1e-12, 10**400):
        calls[f"duration {number!r:.12}"] = ErrorCheck(functools.partial(_run, duration=number), SceneError, "duration")
    calls["1e9 s at 200 samples a second"] = ErrorCheck(lambda: _run(duration=1e9), SceneError, "samples")
    for name in METHODS:
        run = functools.partial(_run, duration=1e9, samples_per_second=1e-8, method=name, accuracy=1e-3)
        calls[f"1e9 s by {name}"] = ErrorCheck(run, TwolinkError)
    return calls


CHECKS = {
    "massless-links": {
        "leaf without <inertial>": ErrorCheck(_massless("feather"), RobotError, "feather"),
        "prismatic leaf": ErrorCheck(_massless("feather", "prismatic"), RobotError, "feather"),
        "continuous leaf": ErrorCheck(_massless("feather", "continuous"), RobotError, "feather"),
        "point mass on its own axis": ErrorCheck(_massless("dot", inertial=_POINT), RobotError, "dot"),
        "leaf on a heavy link": ErrorCheck(_massless("heavy", inertial=_SOLID, more=_LEAF), RobotError, "light"),
    },
    "inconsistent-loops": {
        "a coupler too long": ErrorCheck(lambda: _four_bar(9.0), SceneError, "cannot be closed"),
        "one point at two places": ErrorCheck(_contradiction, SceneError, "cannot be closed"),
    },
    "nan-in-robots": _each(_ROBOT_NUMBERS, RobotError),
    "nan-in-states": _each(_STATES, (QueryError, SceneError, RobotError)),
    "nan-in-settings": _each(_SETTINGS, (SceneError, AccuracyError, QueryError)),
    "nan-in-effects": _each(_EFFECTS, (SceneError, QueryError)),
    "odd-durations": _durations(),
}
