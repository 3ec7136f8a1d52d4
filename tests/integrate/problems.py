"""Robots and starts that the integration tests share, and the tight solution they are held against."""

import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solvers import taylor
from twolink.integrate.steps.step_map import StepMap
from twolink.lagrange.check import arm_urdf
from twolink.native.stepper import Disturbances
from twolink.scenes import Scene

GRAVITY = [tl.effects.Gravity()]
# Dzhanibekov's box: a turn about the middle axis is unstable. Angular velocity after 1 s, computed elsewhere.
BOX = """<robot name="box"><link name="body"><inertial><mass value="10"/><inertia ixx="0.80833333333333333"
iyy="0.68333333333333333" izz="0.14166666666666667" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
BOX_START = [0, 0, 0, 0.1, 5.0, 0.1]
BOX_END = [3.4237984415545984, 2.8191854383979654, 3.9283844494670332]
ONE_JOINT = """<robot name="one"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -1"/>
<mass value="1"/><inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="{kind}"><parent link="base"/><child link="bob"/><axis xyz="{axis}"/>
<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint></robot>"""


def one_joint(kind: str, axis: str = "0 1 0") -> tl.Robot:
    """A body on one joint."""
    return tl.load_robot(ONE_JOINT.format(kind=kind, axis=axis))


def arm() -> Scene:
    """The paper's arm from a state with no symmetry."""
    return Scene(tl.load_robot("two_link"), q=[0.3, -0.7], v=[1.0, -0.5], effects=GRAVITY)


def rods(**start: object) -> Scene:
    """Equal rods, from the horizontal unless given: chaotic."""
    return Scene(tl.load_robot(arm_urdf(1, 1, 1, 1)), effects=GRAVITY, **start)


def box() -> Scene:
    """The spinning box, floating, without gravity."""
    return Scene(tl.load_robot(BOX, root="free"), v=BOX_START)


def random_states(robot: tl.Robot, n: int, seed: int = 0) -> np.ndarray:
    """States (size, n): configurations anywhere on the manifold, velocities up to 1."""
    random = np.random.default_rng(seed)
    q = [pin.integrate(robot.model, robot.neutral, random.uniform(-2, 2, robot.nv)) for _ in range(n)]
    return np.concatenate([robot.normalize(np.array(q)).T, random.uniform(-1, 1, (robot.nv, n))])


def attempted(steps: StepMap, state: np.ndarray, disturbances: Disturbances | None = None) -> np.ndarray:
    """The state array after one attempt of each world."""
    states = np.stack([state, state])
    steps.attempts(states, 1, 1, disturbances)
    return states[1]


def tight(scene: Scene, times: np.ndarray) -> np.ndarray:
    """The states (size, n) at the times, to 1e-14 or so where the motion is not chaotic."""
    return taylor.solve(equations_of(scene), times, 1e-18, precision="extended").x
