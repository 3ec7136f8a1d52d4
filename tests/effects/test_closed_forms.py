"""Simulated motions against closed forms, against MuJoCo, and against planned motions."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import twolink as tl
from tests.effects.bodies import ball, sliders, solved
from tests.effects.cases import CASES, E, robot
from tests.near import assert_near
from tests.urdf_text import joint, link, robot_of
from twolink.effects.forces import SLOW


def wheel(d: float = 0.0, f: float = 0.0) -> tl.Robot:
    dynamics = f'<dynamics damping="{d}" friction="{f}"/>'
    axle = joint("axle", "revolute", "ground", "wheel", effort=3.0, more=dynamics)
    return tl.load_robot(robot_of(link("wheel", 1.0, 0.5), axle))


@pytest.mark.parametrize("source", ["argument", "urdf"])
def test_damped_oscillator(source: str) -> None:
    """I q'' = -k (q - q0) - d q': q0 + A e^(-d t / 2 I) cos(w t + phase)."""
    inertia, k, d, rest = 0.5, 20.0, 0.6, 0.3
    damping = E.JointDamping({"axle": d}) if source == "argument" else E.JointDamping()
    effects = [E.JointSpring({"axle": k}, {"axle": rest}), damping]
    run = solved(wheel(0.0 if source == "argument" else d), effects, 5.0, [1.0], accuracy=1e-10)
    rate, w = d / (2 * inertia), np.sqrt(k / inertia - (d / (2 * inertia)) ** 2)
    expected = rest + (1 - rest) * np.exp(-rate * run.t) * (np.cos(w * run.t) + rate / w * np.sin(w * run.t))
    assert_near(run.q[:, 0], expected, 1e-10)


def test_driven_oscillator_at_resonance() -> None:
    """I q'' = -k q + a sin(w t), w^2 = k / I, from rest: a / (2 I w) (sin(w t) / w - t cos(w t))."""
    run = solved(wheel(), [E.JointSpring({"axle": 8.0}), E.Torque({"axle": E.Sine(0.4, 4.0)})], 5.0, accuracy=1e-10)
    expected = 0.4 / (2 * 0.5 * 4) * (np.sin(4 * run.t) / 4 - run.t * np.cos(4 * run.t))
    assert_near(run.q[:, 0], expected, 1e-10)


@pytest.mark.some(2)
@pytest.mark.parametrize("method", ["auto", "dop853", "taylor", "esdirk43", "scipy-radau"])
def test_falling_with_drag_from_rest(method: str) -> None:
    """v = vt tanh(g t / vt), from |u| = 0 exactly, where the smoothing and its derivatives matter."""
    m, area, g = 2.0, 0.3, 9.81
    vt = np.sqrt(2 * m * g / (1.225 * area))
    scene = tl.Scene(ball(), effects=[E.Gravity(), E.AirDrag("ball", area)])
    accuracy = 1e-9 if method in ("auto", "dop853", "taylor") else 1e-5
    run = tl.simulate(scene, 3.0, accuracy=accuracy, method=method, samples_per_second=20)
    assert_near(run.q[:, 2] + vt**2 / g * np.log(np.cosh(g * run.t / vt)), 0.0, accuracy)
    assert_near(run.v[:, 2] + vt * np.tanh(g * run.t / vt), 0.0, 10 * accuracy)
    assert run.cost.method != "taylor" or method == "taylor"


def test_drag_in_wind_and_energy_in_still_air() -> None:
    """A body in wind w: w - u obeys 1 / (1 / u0 + c t); in still air the energy only falls, also below SLOW."""
    k = 0.5 * 1.225 * 0.5 / 2.0
    run = solved(ball(), [E.AirDrag("ball", 0.5, wind=(4.0, 0, 0))], 5.0)
    assert_near(run.v[:, 0], 4 - 1 / (1 / 4 + k * run.t), 1e-8)
    for speed in (SLOW / 10, 1.0):
        run = tl.simulate(tl.Scene(ball(), v=[speed, 0, 0, 0, 0, 0], effects=[E.AirDrag("ball", 0.5)]), 2.0)
        assert np.all(np.diff(run.energy) <= 0)


def test_spring_between_two_bodies() -> None:
    """The distance of 2 kg and 3 kg on a spring oscillates with the reduced mass 1.2 kg; the centre stays."""
    spring = E.SpringBetween("one_link", "two_link", stiffness=30.0, rest_length=2.0, second_point=(0.5, 0.0, 0.0))
    run = solved(sliders(2.0, 3.0), [spring], 4.0, [0.0, 1.8], accuracy=1e-10)
    distance = run.q[:, 1] + 0.5 - run.q[:, 0]
    assert_near(distance, 2 + 0.3 * np.cos(np.sqrt(30 / 1.2) * run.t), 1e-9)
    assert_near(2 * run.q[:, 0] + 3 * run.q[:, 1], 5.4, 1e-9)


def test_positive_force_between_two_bodies_pulls_them_together() -> None:
    """l' = -F / c (1 - e^(-c t / m)): F > 0 pulls."""
    effect = E.SpringBetween("one_link", "two_link", damping=2.4, force=1.2)
    run = solved(sliders(2.0, 3.0), [effect], 3.0, [0.0, 3.0], accuracy=1e-10)
    speed = run.v[:, 1] - run.v[:, 0]
    assert_near(speed + 1.2 / 2.4 * (1 - np.exp(-2.4 * run.t / 1.2)), 0.0, 1e-9)


def test_points_that_meet_are_singular_unless_the_spring_has_no_length() -> None:
    through = E.SpringBetween("one_link", "two_link", stiffness=30.0)
    run = solved(sliders(2.0, 3.0), [through], 2.0, [0.0, 1.0])
    assert_near(run.q[:, 1] - run.q[:, 0], np.cos(5 * run.t), 1e-8)
    with_length = E.SpringBetween("one_link", "two_link", stiffness=30.0, rest_length=1.0)
    singular = tl.Scene(sliders(2.0, 3.0), effects=[with_length])
    for method in ("auto", "scipy-dop853", "taylor"):
        with pytest.raises(tl.errors.AccuracyError, match="not finite"):
            tl.simulate(singular, 1.0, method=method)


def test_smooth_friction_against_its_closed_form() -> None:
    """I v' = -f tanh(v / s): s log sinh(v / s) falls as f t / I; v is small when Coulomb's stops the wheel."""
    s, f, inertia, v0 = 0.05, 0.7, 0.5, 1.0
    for effect, body in ((E.SmoothFriction({"axle": f}, s), wheel()), (E.SmoothFriction(scale=s), wheel(f=f))):
        run = solved(body, [effect], 1.0, v=[v0])
        expected = s * np.arcsinh(np.sinh(v0 / s) * np.exp(-f * run.t / (inertia * s)))
        assert_near(run.v[:, 0], expected, 1e-8)
    early = run.t < 0.5
    assert_near(run.v[early, 0], v0 - f * run.t[early] / inertia, 1e-3)  # Coulomb's, above 3 s


def test_rotor_and_payload_add_their_inertia() -> None:
    """A torque of 1 N m on I = 0.5 + N^2 J + m r^2 + J_payload."""
    effects = [E.Rotor({"axle": 0.02}, {"axle": -5.0}), E.Torque({"axle": 1.0}),
               E.Payload("wheel", 3.0, (0.5, 0.0, 0.2), (0.1, 0.0, 0.0, 0.1, 0.0, 0.15))]  # fmt: skip
    run = solved(wheel(), effects, 2.0, accuracy=1e-10)
    inertia = 0.5 + 25 * 0.02 + 3 * 0.25 + 0.15
    assert_near(run.q[:, 0], run.t**2 / 2 / inertia, 1e-10)


def test_arm_against_mujoco() -> None:
    """Stiffness, damping, armature, a constant force on the tip, and a payload, by MuJoCo's own passive forces."""
    arm = robot("arm")
    effects = [
        E.Gravity(),
        E.JointSpring({"elbow": 4.0}, {"elbow": 0.2}),
        E.JointDamping({"shoulder": 0.5, "elbow": 0.2}),
        E.Rotor({"shoulder": 0.001}, {"shoulder": 20.0}),
        E.Payload("tip", 0.5),
        E.FrameWrench("tip", (0.0, 0.0, 2.0)),
    ]
    run = solved(arm, effects, 2.0, [0.4, -0.3])
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 -9.81"/><worldbody><body>
<joint axis="0 -1 0" damping="0.5" armature="0.4"/><inertial pos="0.5 0 0" mass="3" diaginertia="1e-12 0.25 0.25"/>
<body pos="1 0 0"><joint axis="0 -1 0" damping="0.2" stiffness="4" springref="0.2"/>
<inertial pos="0.5 0 0" mass="1" diaginertia="1e-12 0.08333333333333333 0.08333333333333333"/>
<body name="tip" pos="1 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-12 1e-12 1e-12"/></body></body></body>
</worldbody><compiler angle="radian" balanceinertia="true"/></mujoco>""")
    data = mujoco.MjData(model)
    data.xfrc_applied[model.body("tip").id, 2] = 2.0

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:] = x[:2], x[2:]
        mujoco.mj_forward(model, data)
        return np.concatenate([x[2:], data.qacc])

    truth = solve_ivp(rate, (0, 2), [0.4, -0.3, 0, 0], method="DOP853", rtol=1e-11, atol=1e-11).y[:2, -1]
    assert_near(run.q[-1], truth, 1e-8)


def planned(joints: int) -> tuple:
    """q(t), v(t), a(t): a sum of sines for each joint."""
    random = np.random.default_rng(4)
    size, w, phase = (random.uniform(a, b, (2, joints)) for a, b in ((0.1, 0.4), (0.5, 3), (0, 6)))

    def at(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = w * t + phase
        return ((size * np.sin(angle)).sum(0), (size * w * np.cos(angle)).sum(0), -(size * w**2 * np.sin(angle)).sum(0))

    return at


@pytest.mark.parametrize("name", ["ur5", "arm"])
def test_manufactured_motion(name: str) -> None:
    """Inverse dynamics of a planned motion, less the effects' torques, drives the robot along the plan."""
    body = robot(name)
    at = planned(body.nv)
    chosen = ["spring", "friction", "drag", "wrench, world", "between", "zero length"] if name == "ur5" else []
    effects = [E.Gravity(), *(CASES[case].effect for case in chosen)]
    if name == "arm":
        effects += [E.JointDamping({"elbow": 0.4}), E.JointSpring({"shoulder": 3.0})]
    scene = tl.Scene(body, *at(0.0)[:2], effects=effects)
    model = scene.robot.model
    data = model.createData()

    def needed(t: float) -> np.ndarray:
        q, v, a = at(t)
        effects = sum((CASES[case].torque(model, q, v, t) for case in chosen), np.zeros(model.nv))
        if name == "arm":
            effects += [-3.0 * q[0], -0.4 * v[1]]
        return np.asarray(pin.rnea(model, data, q, v, a) - effects)

    knots = np.linspace(0, 1.0, 201)
    values = np.array([needed(t) for t in knots])
    drive = E.Torque({joint: E.Sampled(knots, values[:, i], interpolation="cubic", beyond="error")
                      for i, joint in enumerate(body.joint_names)})  # fmt: skip
    driven = tl.Scene(body, scene.q, scene.v, effects=[*effects, drive])
    options = {"method": "taylor", "samples_per_second": 20, "verify": name == "arm"}
    run = tl.simulate(driven, 1.0, accuracy=1e-8, **options)
    assert_near(run.q, [at(t)[0] for t in run.t], 2e-7)  # what cubic pieces of 5 ms leave


TURNER = robot_of(
    '<link name="arm"/>', joint("turn", "revolute", "ground", "arm"), link("tip", 2.0, 0.01),
    joint("lift", "prismatic", "arm", "tip", more='<origin xyz="0.5 0 0"/>'))  # fmt: skip


@pytest.mark.parametrize("accuracy", [1e-6, 1e-10])
def test_a_slip_on_a_circle_ends_as_one_on_a_line(accuracy: float) -> None:
    """I a'' = -k a - mu m g r sign(a'): harmonic about -+F = mu m g r / k, of which each half a period takes 2 F.

    The slip turns by 0.7 rad before it ends: its end must not know in which direction it began.
    """
    stiffness, friction, start = 30.0, 0.1, 0.4
    rate, offset = np.sqrt(stiffness / (2.0 * 0.25 + 0.01)), friction * 2.0 * 9.81 * 0.5 / stiffness
    contact = tl.effects.Contact((("tip", "ground"),), friction, shapes={"tip": (tl.effects.Sphere(0.05),)})
    scene = tl.Scene(tl.load_robot(TURNER), [start, 0.05], duration=1.0,
                     effects=[tl.effects.Gravity(), tl.effects.JointSpring({"turn": stiffness}), contact])  # fmt: skip
    run = tl.simulate(scene, accuracy=accuracy)
    halves = (run.t * rate / np.pi).astype(int)
    amplitude = start - offset - 2.0 * offset * halves
    exact = (-1.0) ** halves * (offset + amplitude * np.cos(rate * run.t - np.pi * halves))
    error = np.abs(run.q[:, 0] - exact)
    assert (error <= run.error).all()
    assert error.max() < 1e-2 * accuracy
