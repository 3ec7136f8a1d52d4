"""Controllers: tracking errors as in theory, limits of effort, and refused arguments."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import ball, slider, solved, times
from tests.effects.cases import E, assert_refused, robot
from tests.effects.test_closed_forms import wheel
from tests.near import assert_near, assert_within
from tests.refusals import refusal
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.effects.effect import Loads
from twolink.errors import SceneError
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import equations_of


def test_pd_is_a_spring_and_damper_about_its_target() -> None:
    run = solved(wheel(), [E.JointPD({"axle": 0.7}, {"axle": 8.0}, {"axle": 1.0}, {"axle": 2.0})], 4.0, accuracy=1e-10)
    same = [E.JointSpring({"axle": 8.0}, {"axle": 0.7}), E.JointDamping({"axle": 1.0}), E.Torque({"axle": 2.0})]
    other = solved(wheel(), same, 4.0, accuracy=1e-10)
    assert_near(run.q, other.q, 2e-10)


@pytest.mark.parametrize("effort", ["urdf", {"axle": 3.0}])
def test_torques_stay_within_their_limits(effort: object) -> None:
    """Far from the target the torque is at its limit of 3 N m: q = 3 t^2 until it falls below."""
    pd = E.JointPD({"axle": 50.0}, {"axle": 1.0}, effort=effort)
    scene = tl.Scene(wheel(), effects=[pd])
    run = tl.simulate(scene, 2.0, accuracy=1e-9)
    assert_near(run.q[:, 0], 3.0 * run.t**2, 1e-8)
    assert run.cost.method != "taylor"
    equations = equations_of(scene)
    motion = KinematicState(scene.robot.model, equations.mechanism, list(run.q.T), list(run.v.T), run.t, Numbers)
    loads = Loads(motion)
    pd.act(motion, loads)
    assert np.array_equal(loads.tau[0], np.full(len(run.t), 3.0))


def test_gravity_compensation_keeps_rest_and_kinetic_energy() -> None:
    """A robot at rest stays at rest; a robot in motion keeps its kinetic energy. On the UR5 with a payload too."""
    effects = [E.Gravity(), E.Payload("tool0", 2.0, (0.0, 0.0, 0.1)), E.GravityCompensation()]
    still = tl.Scene(robot("ur5"), [0.3, -0.8, 1.0, 0.2, 0.5, 0.1], effects=effects)
    assert_near(rate(equations_of(still), 0.0, equations_of(still).start[:, None]), 0.0, 1e-11)
    run = solved(robot("arm"), [E.Gravity(), E.GravityCompensation()], 3.0, [0.3, -0.8], [1.0, -2.0])
    kinetic = run.robot.energy(run.q, run.v)[0]
    assert np.ptp(kinetic) < 1e-7


PATHS = {
    "formulas": {"shoulder": E.Sine(0.4, 2.0), "elbow": E.Polynomial((0.1, 0.5, -0.2, 0.05))},
    "splines": {
        "shoulder": E.Sampled(np.linspace(0, 3, 7), np.sin(np.linspace(0, 3, 7)), interpolation="cubic"),
        "elbow": E.Sampled((0.0, 1.0, 2.0, 3.0), (0.0, 0.4, -0.2, 0.3), interpolation="cubic"),
    },
}


@pytest.mark.parametrize("path", PATHS)
def test_computed_torque_errors_fall_as_in_theory(path: str) -> None:
    """e'' + kd e' + kp e = 0 with critical damping: e = (e0 + (e0' + w e0) t) e^(-w t), gravity or not."""
    from twolink.effects.inputs import derivatives_at

    w = 4.0
    e0, de0 = np.array([0.2, -0.1]), np.array([-0.3, 0.4])
    begin = [derivatives_at(one, 0.0, Numbers) for one in PATHS[path].values()]
    q0, v0 = np.array([x[0] for x in begin], dtype=float) - e0, np.array([x[1] for x in begin], dtype=float) - de0
    control = E.ComputedTorque(PATHS[path], w * w, 2 * w)
    run = solved(robot("arm"), [E.Gravity(), control], 2.9, q0, v0, samples_per_second=30)
    reference = np.stack([derivatives_at(one, run.t, np)[0] * np.ones(len(run.t)) for one in PATHS[path].values()])
    t = run.t[:, None]
    expected = (e0 + (de0 + w * e0) * t) * np.exp(-w * t)
    assert_near(reference.T - run.q, expected, 2e-9)


def test_damping_disturbs_computed_torque_also_where_it_is_a_parameter() -> None:
    """e'' + (kd + d/M) e' + kp e = 0 of one joint, whose M is constant: e and its slope by d in closed form."""
    arm = tl.load_robot("two_link", lock={"elbow": 0.0})
    inertia, kp, kd, e0 = float(arm.mass_matrix([0.0])[0, 0]), 25.0, 2.0, 0.3
    scene = tl.Scene(arm, [e0], effects=[E.Gravity(), E.ComputedTorque({"shoulder": 0.0}, kp, kd)], duration=1.0)

    def end(d: np.ndarray) -> np.ndarray:
        half = (kd + d / inertia) / 2
        w = np.sqrt(kp - half**2)
        return e0 * np.exp(-half) * (np.cos(w) + half / w * np.sin(w))

    damping = np.array([0.0, 2.0, 9.0])
    worlds = tl.simulate_many(scene, parameters={"shoulder.damping": damping}, accuracy=1e-9)
    assert_near(worlds.q[:, 0], end(damping), 1e-9)
    slope = tl.sensitivities(scene, wrt=["shoulder.damping"], accuracy=1e-7).q["shoulder.damping"][-1].item()
    assert slope == pytest.approx(np.diff(end(np.array([-1e-5, 1e-5])))[0] / 2e-5, rel=1e-6)


def test_a_joint_follows_the_paths_of_others() -> None:
    """A third joint keeps the sum of the angles: with paths of degree 5, and the error's own equation off the path."""
    feeding, (a, b) = tl.load_robot("feeding_arm"), ((0.6, -2.1), (1.3, -1.5))
    path = {joint: E.Bezier((p,) * 3 + (q,) * 3, 2.0) for joint, p, q in zip(("shoulder", "elbow"), a, b, strict=True)}
    follow = E.ComputedTorque(path, 16.0, 8.0, following={"wrist": {"shoulder": -1.0, "elbow": -1.0}})
    run = solved(feeding, [E.Gravity(), follow], 2.0, [*a, 1.4])
    s, t = run.t / 2.0, run.t
    expected = np.array(a) + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, np.subtract(b, a))
    assert_near(run.q[:, :2], expected, 2e-9)
    error = 1.5 - 1.4  # of the wrist, which begins beside its path
    assert_near(run.q.sum(axis=1) + error * (1 + 4 * t) * np.exp(-4 * t), 0.0, 2e-9)


def test_a_run_beyond_the_end_of_a_curve_is_refused() -> None:
    curve = E.Bezier((0.0, 0.0, 0.0, 1.0, 1.0, 1.0), 0.2)
    control = E.ComputedTorque({"shoulder": curve, "elbow": curve}, 4.0, 4.0)
    for effect in (control, E.Release(E.Torque({"elbow": E.Bezier((0.0, 1.0), 0.2)}), at=0.1)):
        scene = tl.Scene(robot("arm"), effects=[effect])
        assert tl.simulate(scene, 0.2).t[-1] == 0.2
        with refusal(SceneError, code="curve-ends", match=r"a curve ends at 0.2 s, the run at 0.3 s"):
            tl.simulate(scene, 0.3)


@pytest.mark.slow
def test_computed_torque_on_the_ur5() -> None:
    path = {joint: E.Sine(0.3, 1.0 + 0.2 * i, 0.1 * i) for i, joint in enumerate(robot("ur5").joint_names)}
    q = [0.3 * np.sin(0.1 * i) for i in range(6)]
    v = [0.3 * (1 + 0.2 * i) * np.cos(0.1 * i) for i in range(6)]
    effects = [E.Gravity(), E.Payload("tool0", 3.0), E.ComputedTorque(path, 25.0, 10.0)]
    run = solved(robot("ur5"), effects, 1.0, q, v, accuracy=1e-6, method="scipy-dop853", samples_per_second=10,
                 verify=False)  # fmt: skip
    expected = [0.3 * np.sin((1 + 0.2 * i) * run.t + 0.1 * i) for i in range(6)]
    assert_near(run.q.T, expected, 1e-7)


@pytest.mark.parametrize(
    ("body", "joints", "part"),
    [("floating", ("root_joint",), "one degree of freedom 'root_joint'"), ("floating", ("wrist_1_joint",), "is locked"),
     ("ball", None, "expected joints")],
)  # fmt: skip
def test_weights_that_no_joint_carries_are_refused(body: str, joints: tuple[str, ...] | None, part: str) -> None:
    effect = E.GravityCompensation() if joints is None else E.GravityCompensation(joints)
    assert_refused(ball() if body == "ball" else robot(body), effect, "joints", part)


def test_continuous_joints_are_refused_with_a_remedy() -> None:
    kinova = tl.load_robot("kinova")
    joint = kinova.joint_names[0]
    for effect in (E.JointPD({joint: 1.0}, {joint: 1.0}), E.JointSpring({joint: 1.0})):
        with pytest.raises(SceneError, match=r"is continuous.*type=\"revolute\""):
            tl.Scene(kinova, effects=[effect])
    tl.Scene(kinova, effects=[E.JointDamping({joint: 1.0}), E.GravityCompensation(), E.Rotor({joint: 0.1})])


def spring_of_limited_force(t: np.ndarray, k: float, most: float) -> tuple[np.ndarray, list[float]]:
    """x of 1 kg from 1 m at rest under -k x, but within +-most, and when the limit begins or ceases to act."""
    edge, w = most / k, math.sqrt(k)
    free = math.sqrt(2 * (1 - edge) / most)  # until the limit ceases
    speed = most * free
    inner = 2 * math.atan2(edge * w, speed) / w  # through the middle to -edge
    quarter = free + inner / 2
    s = t % (4 * quarter)
    mirror = np.where(s > 2 * quarter, 4 * quarter - s, s)
    u = np.minimum(mirror, 2 * quarter - mirror)
    middle = (speed**2 / k + edge**2) ** 0.5 * np.sin(w * (quarter - u))
    x = np.where(u < free, 1 - most * u**2 / 2, middle) * np.where(mirror > quarter, -1.0, 1.0)
    ends = [n * 2 * quarter + side for n in range(20) for side in (free, free + inner)]
    return x, ends


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_saturated_spring(accuracy: float) -> None:
    pd = E.JointPD(target={"x": 0.0}, kp={"x": 20.0}, effort={"x": 3.0})
    run = solved(slider(), [pd], 5.0, [1.0], accuracy=accuracy)
    x, ends = spring_of_limited_force(run.t, 20.0, 3.0)
    assert_within(run.q[:, 0], x, run.error)
    assert run.error[-1] <= accuracy
    assert_near(times(run, "limit"), [t for t in ends if t < 5], 10 * accuracy)


def test_a_limit_that_is_never_reached_is_no_event() -> None:
    run = solved(slider(), [E.JointPD({"x": 0.0}, {"x": 4.0}, effort={"x": 4.5})], 5.0, [1.0])
    assert not run.events
    assert_near(run.q[:, 0], np.cos(2 * run.t), 1e-9)


def test_a_limit_that_is_just_touched_changes_nothing() -> None:
    run = solved(slider(), [E.JointPD({"x": 0.0}, {"x": 4.0}, effort={"x": 4.0})], 10.0, [0.0], [2.0])
    assert_near(run.q[:, 0], np.sin(2 * run.t), 1e-9)


@pytest.mark.slow
def test_limits_on_the_arm_against_small_steps() -> None:
    """Events change the effort, not the result: a second way by small steps that know nothing of events."""
    target, effort = {"shoulder": 0.5, "elbow": -0.5}, {"shoulder": 30.0, "elbow": 8.0}
    drive = E.JointPD(target, {"shoulder": 200.0, "elbow": 80.0}, {"shoulder": 20.0, "elbow": 8.0}, effort=effort)
    effects = [E.Gravity(), drive]
    scene = tl.Scene(robot("arm"), [-1.0, 0.5], effects=effects)
    run = tl.simulate(scene, 2.0, accuracy=1e-8)
    other = tl.simulate(scene, 2.0, method="scipy-dop853", tolerance=1e-10)
    assert len(times(run, "limit")) >= 2
    assert_near(run.q, other.q, 1e-6)


@pytest.mark.parametrize("name", ["ball", "zebra"])
def test_what_is_free_has_no_path_wherever_its_joint_stands(name: str) -> None:
    scene = tl.Scene(tl.load_robot("two_link")).with_object("ball", (3.0, 0.0, 0.5), name=name)
    with pytest.raises(SceneError, match=f"no path for '{name}'; JointPD, for what is free has no motor"):
        scene.with_effects([tl.effects.ComputedTorque({"shoulder": 0.0, "elbow": 0.0}, kp=1.0, kd=1.0)])
