"""Light bodies with damping: the implicit method is chosen by its cost, and its steps over numbers are exact."""

import numpy as np
import pytest

import twolink as tl
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import fastest_decay, rate
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solver import choose
from twolink.integrate.steps.step_formulas import _inverse, _jacobian

E = tl.effects
INERTIA, DAMPING, SPEED = 1e-5, 0.1, 20.0  # kg m^2, N m s/rad, rad/s


def wheel_and_cart(inertia: float = INERTIA) -> tl.Scene:
    """A cart of 2 kg on a rail, and a light wheel on it whose axle is damped: w = w0 exp(-d t / I)."""
    text = f"""<robot name="cart"><link name="rail"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="wheel"><inertial><mass value="0.1"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="axle" type="revolute"><parent link="cart"/><child link="wheel"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""
    damping = E.JointDamping({"axle": DAMPING})
    return tl.Scene(tl.load_robot(text), [0.0, 0.0], [1.0, SPEED], effects=[damping])


def test_the_fastest_decay_is_that_of_the_wheel() -> None:
    assert fastest_decay(equations_of(wheel_and_cart())) == pytest.approx(DAMPING / INERTIA, rel=1e-3)
    assert fastest_decay(equations_of(tl.load_scene("arm-swing"))) < 10.0


@pytest.mark.parametrize(("inertia", "method"), [(1e-2, "explicit"), (1e-8, "esdirk43")])
def test_the_implicit_method_is_chosen_by_its_cost(inertia: float, method: str) -> None:
    scene = wheel_and_cart(inertia)
    choice = choose(equations_of(scene), 1e-6, 2.0, "auto")
    assert (choice.method.kind == "implicit") == (method == "esdirk43")
    assert ("a mode decays" in choice.why) == (method == "esdirk43")
    run = tl.simulate(scene, 2.0)
    assert run.cost.steps < 2_000
    rate = DAMPING / inertia
    exact = np.stack([run.t, SPEED / rate * -np.expm1(-rate * run.t)], axis=1)
    assert (np.abs(run.q - exact).max(axis=1) <= run.error).all()


def moving(name: str) -> Equations:
    """A robot in motion from a random state; free ones turn about all axes."""
    robot = tl.load_robot(name, root="free" if name == "go1" else "fixed")
    q, v = robot.random_state(1, seed=3)
    damping = E.JointDamping({joint.name: 0.1 for joint in robot.joints if joint.kind == "vector"})
    return equations_of(tl.Scene(robot, q[0], 3.0 * v[0], effects=[E.Gravity(), damping]))


@pytest.mark.parametrize("name", ["go1", "kinova", "ur5"])
def test_the_jacobian_of_the_implicit_steps(name: str) -> None:
    """Along random directions it is the rate's change."""
    equations = moving(name)
    size, random = equations.space.size, np.random.default_rng(0)
    x = np.stack([equations.start, equations.start + 1e-3], axis=1)
    jacobian = _jacobian(lambda t, y: rate(equations, t, y), np.zeros(2), x, equations.moving)
    direction = random.standard_normal((size, 1))
    h = 1e-5
    change = (rate(equations, 0.0, x + h * direction) - rate(equations, 0.0, x - h * direction)) / (2 * h)
    np.testing.assert_allclose((jacobian @ direction)[..., 0].T, change, rtol=1e-4, atol=1e-5 * np.abs(change).max())


def test_a_singular_matrix_gives_no_number() -> None:
    assert np.isnan(_inverse(np.stack([np.zeros((2, 2)), np.eye(2)]))).all(axis=(1, 2)).tolist() == [True, False]
