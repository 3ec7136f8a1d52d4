"""Steps in which the same points press, as one compiled function: the same as those whose problem is solved."""

import math
from collections.abc import Callable

import numpy as np
import pytest

import twolink as tl
from tests.dynamics import robots
from tests.effects.bodies import G, ball
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.contact import held
from twolink.contact.bodies import Multibody
from twolink.contact.held import HeldSteps
from twolink.contact.held_step import missed, moved, newton, velocities
from twolink.contact.impulses import ContactProblem, solve_impulses
from twolink.contact.stepping import ContactStepper
from twolink.contact.steps import Memory
from twolink.integrate.motion.scene_equations import equations_of

E = tl.effects
BALL = {"ball": (E.Sphere(0.1),)}
ANGLE = 0.3
INCLINE = E.Plane((-math.sin(ANGLE), 0.0, math.cos(ANGLE)))


def incline() -> tl.Scene:
    """A ball that rolls down."""
    n = INCLINE.normal
    effects = [E.Gravity(), E.Contact((("ball", INCLINE),), 0.2, shapes=BALL)]
    return tl.Scene(ball(), [0.1 * n[0], 0, 0.1 * n[2], 0, 0, 0, 1], effects=effects)


def pushed() -> tl.Scene:
    """A ball that rolls, with more and more of a force at its top, until it slides and is lifted."""
    push = (E.Polynomial((0.0, 40.0)), 0.0, E.Polynomial((0.0, 0.0, 50.0)))
    effects = [E.Gravity(), E.FrameWrench("ball", push, point=(0.0, 0.0, -0.05)),
               E.Contact(("ground",), 0.2, static=0.25, shapes=BALL)]  # fmt: skip
    return tl.Scene(ball(), [0, 0, 0.1, 0, 0, 0, 1], effects=effects)


def skidding() -> tl.Scene:
    """A ball that slides along a curve until it rolls."""
    effects = [E.Gravity(), E.Contact(("ground",), 0.2, shapes=BALL)]
    return tl.Scene(ball(), [0, 0, 0.1, 0, 0, 0, 1], [2, 0, 0, 10, 0, 1], effects)


def falling() -> tl.Scene:
    """A body on a foot that sticks tips over about changing axes, and touches the ground with its other end."""
    inertial = ('<inertial><origin xyz="0.04 0.02 0.1"/><mass value="2"/><inertia ixx="0.03" iyy="0.02" izz="0.02" '
                'ixy="0" ixz="0" iyz="0"/></inertial>')  # fmt: skip
    robot = tl.load_robot(f'<robot name="top"><link name="top">{inertial}</link></robot>', root="free")
    ends = {"top": (E.Sphere(0.05), E.Sphere(0.05, (0.4, 0.02, 0.3)))}
    effects = [E.Gravity(), E.Contact(("ground",), 0.9, shapes=ends)]
    return tl.Scene(robot, [0, 0, 0.05, 0, 0, 0, 1], [0, 0, 0, 0, 0, 3.5], effects)


def on_wheels() -> tl.Scene:
    """A slider on a planar joint, whose axes turn with it, held on the ground by friction until it is pushed away."""
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    text = (f'<robot name="cart"><link name="ground"/><link name="cart"><inertial><mass value="1"/>{inertia}'
            f'<link name="foot"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>{inertia}'
            '<joint name="plane" type="planar"><parent link="ground"/><child link="cart"/><axis xyz="0 0 1"/></joint>'
            '<joint name="lift" type="prismatic"><parent link="cart"/><child link="foot"/><axis xyz="0 0 1"/><limit '
            'lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>')  # fmt: skip
    push = (E.Polynomial((0.0, 30.0)), 0.0, 0.0)
    effects = [E.Gravity(), E.FrameWrench("foot", push, point=(0.0, 0.1, 0.0)),
               E.Contact(("ground",), 0.4, shapes={"foot": (E.Sphere(0.1),)})]  # fmt: skip
    return tl.Scene(tl.load_robot(text), [0, 0, 1, 0, 0.1], [0, 0, 0.5, 0], effects)


def landing() -> tl.Scene:
    """A body on a sprung leg falls on its foot, whose gap stays a micrometre open after the impact."""
    inertia = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    text = (f'<robot name="leg"><link name="body"><inertial><mass value="2"/>{inertia.format(0.02)}'
            f'<link name="shank"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/>{inertia.format(0.001)}'
            '<joint name="knee" type="revolute"><parent link="body"/><child link="shank"/><axis xyz="0 1 0"/>'
            '<limit lower="-3" upper="3" effort="99" velocity="99"/></joint>'
            "</robot>")  # fmt: skip
    effects = [E.Gravity(), E.JointSpring({"knee": 30.0}), E.JointDamping({"knee": 0.3}),
               E.Contact((("shank", "ground"),), 0.9, shapes={"shank": (E.Sphere(0.02, (0, 0, -0.2)),)})]  # fmt: skip
    robot = tl.load_robot(text, root="free")
    return tl.Scene(robot, [0, 0, 0.23, 0, 0, 0, 1, 0.4], effects=effects)


def run_of(scene: tl.Scene, step: float = 0.01) -> tl.Trajectory:
    return tl.simulate(scene, 0.5, contact="stepped", step=step, samples_per_second=20, verify=False)


@pytest.mark.parametrize("make", [incline, pushed, skidding, falling, on_wheels, landing])
def test_held_steps_are_those_of_the_contact_problem(
    make: Callable[[], tl.Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    step = 1e-3 if make is landing else 0.01
    quick = run_of(make(), step)
    monkeypatch.setattr(HeldSteps, "of", lambda *_: None)
    solved = run_of(make(), step)
    assert quick.contact_record is not None
    assert quick.contact_record["solvers"]["held"] > 10
    assert quick.contact_record["feasibility"] < 1e-11
    assert solved.contact_record is not None
    assert quick.contact_record["overlap"] == pytest.approx(solved.contact_record["overlap"], rel=1e-5, abs=1e-12)
    assert np.abs(quick.q - solved.q).max() < 1e-9
    assert np.abs(quick.v - solved.v).max() < 1e-8
    together, apart = (np.nan_to_num(list(run.contact_forces.values())).sum(axis=0) for run in (quick, solved))
    assert together == pytest.approx(apart, abs=1e-7)  # of all pairs: two feet may press against each other


def test_a_held_ball_rolls_as_its_closed_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """5/7 g sin. The name of its program is one of a file."""
    names: list[str] = []
    make = held.arrays_named
    monkeypatch.setattr(held, "arrays_named", lambda name, *more: (names.append(name), make(name, *more))[1])
    run = run_of(incline())
    assert 0 < max(map(len, names)) < 100  # file systems end at 255, and points are many
    down = np.linalg.norm(run.q[:, :3] - run.q[0, :3], axis=1)
    assert np.abs(down - 5 / 7 * G * math.sin(ANGLE) * run.t**2 / 2).max() < 1e-12


def test_steps_in_which_a_ball_slides_are_held() -> None:
    """The slip u of its lowest point keeps its direction: x'' = -mu g u / |u|."""
    run = tl.simulate(skidding(), 0.2, contact="stepped", step=0.01, samples_per_second=20, verify=False)
    assert run.contact_record is not None
    assert run.contact_record["solvers"] == {"newton": 1, "held": 19}
    slip = np.array([2.0, 1.0])  # v + omega x r of r = (0, 0, -0.1)
    along = -0.2 * G * slip / np.linalg.norm(slip)
    assert run.q[:, :2] == pytest.approx(np.outer(run.t, [2, 0]) + np.outer(run.t**2, along / 2), abs=1e-12)


def test_many_points_that_slide_are_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling would take long."""
    monkeypatch.setattr(held, "_program", lambda *_: None)
    robot = tl.load_robot("solo12", root="free")
    links = [name for name in robot.frame_names if name.endswith(("FOOT", "LOWER_LEG"))]
    shapes = {name: (E.Sphere(0.01),) for name in links}
    contact = E.Contact(tuple((name, "ground") for name in links), 0.5, shapes=shapes)
    stepper = ContactStepper(equations_of(tl.Scene(robot)), [contact])
    keys = np.sort(stepper.detector.groups[0].key)

    def known(count: int, *, stuck: bool) -> bool:
        ones = np.ones(count, bool)
        memory = Memory(keys[:count], np.zeros((count, 3)), stuck & ones, ones, np.zeros((2, robot.nv)))
        return stepper.held.of(memory) is not None

    assert known(4, stuck=False)
    assert not known(5, stuck=False)
    assert known(5, stuck=True)


def test_newtons_formula_finds_the_impulses_of_points_that_stick_and_slide() -> None:
    random = np.random.default_rng(5)
    rows = random.normal(size=(9, 12))
    g, mu = rows @ rows.T, np.array([0.1, 0.5, 5.0])
    wanted = np.array([[0.02, 0.01, 1.0], [0.1, -0.2, 2.0], [0.3, 0.4, 1.0]])
    b = -(g @ wanted.ravel()).reshape(3, 3) + [[0.4, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    exact = solve_impulses(ContactProblem(g, b, mu), wanted)
    assert exact.solved
    assert (exact.p[:, 2] > 0.1).all()
    assert np.hypot(*exact.u[:, :2].T).max() > 0.1
    matrix, flat, mus = g.tolist(), b.ravel().tolist(), mu.tolist()
    p = newton(matrix, flat, mus, list(1.02 * exact.p.ravel()), Numbers)
    assert p == pytest.approx(exact.p.ravel(), abs=1e-12)
    assert np.abs(missed(matrix, velocities(matrix, flat, p), p, mus, Numbers)).max() < 1e-12


@pytest.mark.parametrize("name", ["two_link", "planar", "spherical", "anymal"])
def test_formulas_move_configurations_as_pinocchio_does(name: str) -> None:
    robot = robots.of_every_kind()[name]
    bodies, mech = Multibody(equations_of(tl.Scene(robot))), mechanism(robot.model)
    (q,), (change,) = robot.random_state(1, seed=3)
    for size in (1.0, 1e-4, 0.0):
        expected = bodies.moved(q, size * change)
        assert moved(mech, list(q), size * change, Numbers) == pytest.approx(expected, abs=1e-14)
