"""Sensitivities: within their own bars of closed forms and of differences of exact motions."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.near import assert_near, assert_within
from tests.refusals import refusal
from twolink.algorithms.mechanism import nominal, with_nominal
from twolink.effects.conditions import JointReaches
from twolink.errors import AccuracyError, CertificationError, SceneError
from twolink.integrate.derivatives.variational_steps import certify_variation, variational_rate
from twolink.integrate.motion.scene_equations import equations_of
from twolink.scenes.parameters import effect_numbers, named_parameters, parameters_of, scene_with, with_number

CART = """<robot name="cart"><link name="rail"/><link name="cart"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="100" velocity="100"/></joint></robot>"""
FREE = """<robot name="brick"><link name="brick"><inertial><mass value="2"/><origin xyz="0.1 0 0.05"/>
<inertia ixx="1" iyy="2" izz="2.5" ixy="0.1" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1"/><origin xyz="0 0.2 0"/>
<inertia ixx="0.2" iyy="0.1" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="brick"/><child link="arm"/><axis xyz="0.6 0 0.8"/></joint>
</robot>"""
TWO, FOUR = ((1, 1 / 2),), ((1, 2 / 3), (2, -1 / 12))
EIGHT = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))  # their error is the eighth power of the step


def differences(base: tl.Scene, make, step: float, duration: float, samples: float, weights=EIGHT, method="auto"):
    """d(q, v)/dp (n, 2 nv) at the samples, from exact motions of scenes make(p - p0)."""
    robot = base.robot

    def state(shift: float) -> np.ndarray:
        run = tl.simulate(
            make(shift), duration, accuracy=1e-12, method=method, samples_per_second=samples, verify=False
        )
        return np.concatenate([robot.difference(start, run.q), run.v], axis=1)

    start = tl.simulate(base, duration, accuracy=1e-12, method=method, samples_per_second=samples, verify=False).q
    return sum(weight * (state(k * step) - state(-k * step)) for k, weight in weights) / step


def moved(scene: tl.Scene, entry: int, shift: float) -> tl.Scene:
    """The scene from a start moved along a tangent direction."""
    nv = scene.robot.nv
    change = np.eye(2 * nv)[entry] * shift
    q, v = scene.robot.integrate(scene.q, change[:nv]), scene.v + change[nv:]
    return tl.Scene(scene.base, q, v, scene.effects, scene.duration)


def require_within_bars(s: tl.Sensitivities, name: str, truth: np.ndarray, noise: float, column: int = 0) -> None:
    """Require that every entry is within its bar of what differences of motions give, up to their own error."""
    ours = np.concatenate([s.q[name], s.v[name]], axis=1)[:, :, column]
    size = 1.0 + np.abs(truth).max()
    assert_within(ours, truth, s.error[name] + noise * size)


def test_an_oscillator_has_the_closed_form() -> None:
    """q = q0 cos wt + v0 / w sin wt with w^2 = k / m: its derivatives by q0, v0 and m are known."""
    q0, v0, mass, k = 0.3, -0.4, 2.0, 18.0
    scene = tl.Scene(tl.load_robot(CART), [q0], [v0], [tl.effects.JointSpring({"slide": k})])
    s = tl.sensitivities(scene, wrt=["q", "v.slide", "cart.mass"], duration=5.0, accuracy=1e-10)
    t, w = s.run.t, np.sqrt(k / mass)
    cos, sin = np.cos(w * t), np.sin(w * t)
    by_w = np.array([-q0 * t * sin + v0 * (t * cos / w - sin / w**2),
                     -q0 * (sin + w * t * cos) - v0 * t * sin])  # fmt: skip
    truth = {"q": [cos, -w * sin], "v.slide": [sin / w, cos], "cart.mass": by_w * (-w / (2 * mass))}
    for name, (q, v) in truth.items():
        assert s.q[name].shape == (len(t), 1, 1)
        error = np.maximum(np.abs(s.q[name][:, 0, 0] - q), np.abs(s.v[name][:, 0, 0] - v))
        assert (error <= s.error[name]).all()
        assert s.error[name].max() <= 1e-10 * max(1.0, np.abs([q, v]).max())


def test_bars_hold_where_a_motion_is_smaller_than_the_roundings_that_it_amplifies() -> None:
    """A pendulum 1e-11 rad off its top: q = q0 cosh wt, w^2 = m g / I. The derivatives are along a second solution,
    which starts roundings away: these make a larger error than the tolerance does."""
    q0, g, mass, inertia = 1e-11, 9.81, 2.0, 3.0
    robot = tl.load_robot(CART.replace("prismatic", "revolute").replace("1 0 0", "0 1 0").replace(
        '<mass value="2"/>', '<mass value="2"/><origin xyz="0 0 1"/>'))  # fmt: skip
    scene = tl.Scene(robot, [q0], effects=[tl.effects.Gravity()])
    s = tl.sensitivities(scene, wrt=["gravity.z"], duration=6.0, accuracy=1e-7)
    t, w = s.run.t, np.sqrt(mass * g / inertia)
    by_w = q0 * np.array([t * np.sinh(w * t), np.sinh(w * t) + w * t * np.cosh(w * t)])
    require_within_bars(s, "gravity.z", -(by_w * w / (2 * g)).T, 1e-13)


def test_a_motion_at_rest_has_sensitivities_that_grow() -> None:
    """The upright pendulum stands still, so that its own steps are long, while d q/d q0 = cosh(w t)."""
    scene = tl.Scene(tl.load_robot("two_link"), [np.pi / 2, 0.0], effects=[tl.effects.Gravity()])
    s = tl.sensitivities(scene, wrt="q", duration=2.0, accuracy=1e-8, samples_per_second=20)
    a = scene.robot.forward_dynamics_derivatives(scene.q, scene.v, np.zeros(2))[0]
    squares, vectors = np.linalg.eig(a)
    assert (squares > 0).all()
    modes = np.cosh(np.sqrt(squares) * s.run.t[:, None])
    truth = np.einsum("ij,nj,jk->nik", vectors, modes, np.linalg.inv(vectors))
    assert np.abs(truth).max() > 100
    assert_within(s.q["q"], truth, s.error["q"])
    assert (s.error["q"] <= 1e-8 * np.abs(truth).max(axis=(1, 2)) + 1e-12).all()


def test_the_arm_agrees_with_quadruple_precision_to_nine_digits() -> None:
    scene, step = tl.load_scene("arm-swing"), 1e-6
    s = tl.sensitivities(scene, wrt=["q", "v"], duration=3.0, accuracy=1e-9, samples_per_second=10)
    for column in range(4):
        name, k = ("q", "v")[column // 2], column % 2
        ahead, behind = (
            tl.simulate(
                moved(scene, column, shift), 3.0, accuracy=1e-20, samples_per_second=10, verify=False, precision="quad"
            ).precise
            for shift in (step, -step)
        )
        truth = (ahead - behind).astype(float) / (2 * step)
        ours = np.concatenate([s.q[name], s.v[name]], axis=1)[:, :, k]
        size = np.maximum.accumulate(np.maximum(1.0, np.abs(truth).max(axis=1)))
        assert_within(ours, truth, np.minimum(s.error[name], 1e-9 * size) + 1e-10)
        assert s.error[name][-1] <= 1e-9 * size[-1]


@pytest.mark.slow
def test_free_bodies_are_differentiated_in_the_tangent_space() -> None:
    """A brick with an arm, thrown: six degrees of freedom with a quaternion, and a (cos, sin) pair."""
    robot = tl.load_robot(FREE, root="free")
    v = [0.3, -0.2, 1.0, 1.0, -2.0, 0.5, 1.5]
    q = robot.random_state(1, seed=4)[0][0]
    scene = tl.Scene(robot, q, v, [tl.effects.Gravity(), tl.effects.JointDamping({"hinge": 0.1})])
    s = tl.sensitivities(scene, wrt=["q", "v"], duration=1.0, accuracy=1e-8, samples_per_second=20)
    assert s.q["q"].shape == (21, 7, 7)
    for column in (1, 4, 6, 9, 13):
        truth = differences(scene, lambda shift, c=column: moved(scene, c, shift), 0.02, 1.0, 20)
        require_within_bars(s, ("q", "v")[column // 7], truth, 1e-9, column % 7)


CONSTANTS = ["forearm.mass", "forearm.com.x", "upper_arm.inertia.yy", "gravity.z", "elbow.origin.z"]


@pytest.mark.parametrize("name", CONSTANTS)
def test_physical_constants_agree_with_worlds_that_have_others(name: str) -> None:
    scene = tl.load_scene("arm-swing")
    s = tl.sensitivities(scene, wrt=[name], duration=2.0, accuracy=1e-8, samples_per_second=10)
    shifts, weights = zip(*[(k * sign, weight * sign) for k, weight in EIGHT for sign in (1, -1)], strict=True)
    step = 0.01
    values = nominal(scene.robot.model, name) + step * np.array(shifts)
    worlds = tl.simulate_many(scene, parameters={name: values}, duration=2.0, accuracy=1e-12, verify=False)
    truth = np.concatenate([worlds.q, worlds.v], axis=1).T @ np.array(weights) / step
    ours = np.concatenate([s.q[name][-1, :, 0], s.v[name][-1, :, 0]])
    assert np.abs(truth).max() > 1e-3
    assert np.abs(ours - truth).max() <= s.error[name][-1] + 1e-8 * (1.0 + np.abs(truth).max())


EFFECTS = {
    "joint-damping": (tl.effects.JointDamping({"elbow": 0.05}), "damping.elbow"),
    "joint-spring": (tl.effects.JointSpring({"elbow": 2.0}, {"elbow": 0.3}), "rest.elbow"),
    "joint-pd": (tl.effects.JointPD({"elbow": tl.effects.Sine(0.5, 3.0)}, {"elbow": 3.0}), "kp.elbow"),
    "target": (tl.effects.JointPD({"elbow": tl.effects.Sine(0.5, 3.0)}, {"elbow": 3.0}), "target.elbow.frequency"),
    "torque": (tl.effects.Torque({"shoulder": tl.effects.Polynomial((0.1, 0.2))}), "inputs.shoulder.coefficients.1"),
    "friction": (tl.effects.SmoothFriction({"elbow": 0.05}, 0.1), "friction.elbow"),
    "drag": (tl.effects.AirDrag("forearm", 0.5), "area"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", EFFECTS)
def test_numbers_of_effects_agree_with_scenes_that_have_others(case: str) -> None:
    effect, path = EFFECTS[case]
    scene = tl.Scene(tl.load_robot("two_link"), [0.2, 0.4], [0.3, -1.0], [tl.effects.Gravity(), effect])
    name = f"effects.1.{path}"
    s = tl.sensitivities(scene, wrt=[name], duration=0.5, accuracy=1e-8, samples_per_second=20)
    value = effect_numbers(scene)[name]

    def changed(shift: float) -> tl.Scene:
        return scene.with_effects([tl.effects.Gravity(), with_number(effect, path.split("."), value + shift)])

    truth = differences(scene, changed, 2e-3, 0.5, 20, FOUR, "scipy-dop853")  # which compiles nothing
    assert np.abs(truth).max() > 1e-4
    require_within_bars(s, name, truth, 1e-8)


@pytest.mark.slow
def test_moments_of_a_point_mass_count_as_those_of_its_link() -> None:
    """No body has one principal moment alone, and yet the derivative by it is that by the link's own."""
    effects = [tl.effects.Gravity(), tl.effects.Payload("forearm", 1.0, (0.2, 0.0, 0.1))]
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], [0.3, -1.0], effects, 0.5)
    s = tl.sensitivities(scene, wrt=["effects.1.inertia.3", "forearm.inertia.yy"], accuracy=1e-9)
    ours, links = (s.v[name] for name in s.q)
    assert np.abs(links).max() > 0.1
    assert np.abs(ours - links).max() <= 2e-9 * np.abs(links).max()


def test_values_are_those_of_the_link_without_what_it_releases() -> None:
    effects = [tl.effects.Gravity(), tl.effects.Release(tl.effects.Payload("forearm", 1.0, (0.2, 0.0, 0.1)), at=0.4)]
    scene = tl.Scene(tl.load_robot("two_link"), effects=effects, duration=0.1)
    names = ["forearm.mass", "forearm.com.x", "forearm.inertia.yy", "gravity.z"]
    nominal = {one.name: one.nominal for one in named_parameters(scene, names, "wrt")}
    assert tl.sensitivities(scene, wrt=names).values == nominal
    assert nominal["forearm.mass"] == 1.0


SWING = """<robot name="swing"><link name="ground"/><link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="revolute"><parent link="ground"/><child link="arm"/><axis xyz="0 1 0"/>
<dynamics damping="0.1"/><limit lower="-9" upper="9" effort="5" velocity="5"/></joint></robot>"""


def test_damping_of_the_urdf_does_not_act_and_is_no_nominal_value() -> None:
    """Another value of JOINT.damping acts as a JointDamping does."""
    name, gravity = "axle.damping", tl.effects.Gravity()
    scene = tl.Scene(tl.load_robot(SWING), [1.2], effects=[gravity], duration=0.8)
    plain = tl.simulate(scene, accuracy=1e-10).q[-1]
    nominal = parameters_of(scene)[name].nominal
    assert_near(tl.simulate(scene_with(scene, {name: nominal}), accuracy=1e-10).q[-1], plain, 2e-10)
    worlds = tl.simulate_many(scene, parameters={name: [0.0, 0.1]}, accuracy=1e-11)
    damped = scene.with_effects([gravity, tl.effects.JointDamping({"axle": 0.1})])
    ends = np.array([plain, tl.simulate(damped, accuracy=1e-10).q[-1]])
    assert_near(worlds.q, ends, 2e-10)
    assert abs(ends[1] - ends[0]) > 0.01
    s = tl.sensitivities(damped, wrt=[name, "effects.1.damping.axle"], accuracy=1e-9)
    assert s.values == {name: nominal, "effects.1.damping.axle": 0.1}
    assert_near(s.q[name], s.q["effects.1.damping.axle"], 2e-9)


def test_loops_are_differentiated_along_what_they_allow() -> None:
    scene = tl.load_scene("crank-spring")
    s = tl.sensitivities(scene, wrt=["q", "v"], duration=1.0, accuracy=1e-8, samples_per_second=20)
    for column in (0, 1, 3):
        truth = differences(scene, lambda shift, c=column: moved(scene, c, shift), 1e-3, 1.0, 20)
        require_within_bars(s, ("q", "v")[column // 3], truth, 1e-7, column % 3)


GRAVITY = tl.effects.Gravity()
EVENTS = {
    "stops": tl.effects.JointStops({"elbow": (-0.3, 0.8)}, 0.6),
    "stops without bounces": tl.effects.JointStops({"elbow": (-0.3, 0.8)}, 0.0),
    "stick and slip": tl.effects.DryFriction({"elbow": 2.0, "shoulder": 0.5}),
    "release at a time": tl.effects.Release(tl.effects.Payload("forearm", 1.0, (0.0, 0.0, 0.3)), at=0.5),
    "release at an angle": tl.effects.Release(
        tl.effects.Payload("forearm", 1.0, (0.0, 0.0, 0.3)), when=JointReaches("shoulder", -0.5)
    ),
}


@pytest.mark.some(2)
@pytest.mark.parametrize("case", EVENTS)
def test_they_go_on_through_events(case: str) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.2, 0.4], [0.3, -1.0], [GRAVITY, EVENTS[case]])
    s = tl.sensitivities(scene, wrt=["q", "v.elbow"], duration=1.3, accuracy=1e-7, samples_per_second=20)
    assert s.run.events
    for name, column, entry in (("q", 0, 0), ("q", 1, 1), ("v.elbow", 0, 3)):
        truth = differences(scene, lambda shift, k=entry: moved(scene, k, shift), 1e-4, 1.3, 20)
        require_within_bars(s, name, truth, 1e-8, column)


@pytest.mark.slow
def test_constants_change_events_too() -> None:
    """Gravity changes when a joint sticks and slips, and a mass what an impact does to the other joint."""
    start = (tl.load_robot("two_link"), [0.2, 0.4], [0.3, -1.0])
    scene = tl.Scene(*start, [GRAVITY, EVENTS["stops"]])
    s = tl.sensitivities(scene, wrt=["upper_arm.mass"], duration=0.6, accuracy=1e-7, samples_per_second=20)
    mass = nominal(scene.base.model, "upper_arm.mass")

    def heavier(shift: float) -> tl.Scene:
        robot = scene.base.changed(lambda model: with_nominal(model, "upper_arm.mass", mass + shift))
        return tl.Scene(robot, scene.q, scene.v, scene.effects)

    require_within_bars(s, "upper_arm.mass", differences(scene, heavier, 1e-4, 0.6, 20, TWO), 1e-6)
    scene = tl.Scene(*start, [GRAVITY, EVENTS["stick and slip"]])
    s = tl.sensitivities(scene, wrt=["gravity.z"], duration=0.6, accuracy=1e-7, samples_per_second=20)

    def falling(shift: float) -> tl.Scene:
        return scene.with_effects([tl.effects.Gravity((0.0, 0.0, -9.81 + shift)), EVENTS["stick and slip"]])

    require_within_bars(s, "gravity.z", differences(scene, falling, 1e-4, 0.6, 20, TWO), 1e-6)


def test_a_bouncing_ball_has_the_closed_form() -> None:
    """After n impacts from height h: v = e^n sqrt(2 g h) - g (t - t_n), which gives dv/dh with dt_n/dh."""
    scene, e, g, h = tl.load_scene("bouncing-ball"), 0.6, 9.81, 1.0
    s = tl.sensitivities(scene, wrt="q", duration=1.2, accuracy=1e-9)
    fall = np.sqrt(2 * h / g)
    impacts = np.cumsum([fall, 2 * e * fall, 2 * e**2 * fall])
    count = np.searchsorted(impacts, s.run.t, side="right")
    speed = np.sqrt(2 * g * h)
    last = np.concatenate([[0.0], impacts])[count]  # t_n, which grows as the root of h
    truth = np.where(count == 0, 0.0, e**count * speed / (2 * h) + g * last / (2 * h))
    assert count[-1] == 2
    assert_within(s.v["q"][:, 0, 0], truth, s.error["q"] + 1e-12)


def test_differences_through_impacts_are_within_the_bar() -> None:
    """A ball by gravity, whose motion has no truncation: what remains are the roundings of differences at impacts.

    z = u s - g s^2 / 2, s = t - t_n, with the speed u = e^n w after n impacts, w^2 = v^2 + 2 g h.
    """
    h, v, g, e, duration = 0.8125, -0.4375, 9.75, 0.6875, 1.684
    effects = [tl.effects.Gravity((0.0, 0.0, -g)), tl.effects.PlaneContact("ball", restitution=e)]
    scene = tl.Scene(tl.load_scene("bouncing-ball").base, [h], [v], effects)
    found = tl.sensitivities(
        scene, wrt=["gravity.z"], duration=duration, accuracy=1.29e-9, samples_per_second=40 / duration
    )
    w, t = np.sqrt(v * v + 2 * g * h), found.run.t
    dw = h / w
    for n in range(5):
        flights = 2 * sum(e**j for j in range(1, n))  # in units of w / g, after the first impact
        begin, later = ((v + w + flights * w) / g, (dw + flights * dw) / g) if n else (0.0, 0.0)
        later -= begin / g
        end = begin + 2 * e**n * w / g if n else (v + w) / g
        now = (t > begin) & (t < end) if n else t < end
        s, u, du = t[now] - begin, e**n * w if n else v, e**n * dw if n else 0.0
        exact = np.array([du * s - u * later - s * s / 2 + g * s * later, du - s + g * later])
        ours = np.array([found.q["gravity.z"][now, 0, 0], found.v["gravity.z"][now, 0, 0]])
        assert (np.abs(ours + exact) <= found.error["gravity.z"][now] + 1e-15).all()  # gravity.z = -g
        assert now.any()
    assert found.error["gravity.z"][-1] < 1e-10


def test_events_without_derivatives_are_named() -> None:
    """Two joints that hit their stops in one instant; a joint that is held at the start."""
    sliders = tl.load_scene(Path(tl.__file__).parent / "hard" / "scenes" / "two-stops.toml")
    with refusal(AccuracyError, code="sensitivity-undefined"):
        tl.sensitivities(sliders, wrt="q", duration=2.0)
    arm = tl.Scene(tl.load_robot("two_link"), effects=[GRAVITY, tl.effects.DryFriction({"elbow": 100.0})])
    with refusal(AccuracyError, code="sensitivity-undefined", match="elbow"):
        tl.sensitivities(arm, wrt="v", duration=0.5)
    assert tl.sensitivities(arm, wrt=["q", "v.shoulder"], duration=0.5).q["q"].shape[1:] == (2, 2)


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("damping", [1e5, 1e7, 1e9])
def test_derivatives_that_overflow_are_an_error_and_no_number(damping: float) -> None:
    """The elbow comes to rest within some steps of 1 / damping: explicit steps along the motion grow without end."""
    effects = [tl.effects.Gravity(), tl.effects.JointDamping({"elbow": damping})]
    scene = tl.Scene(tl.load_robot("two_link"), [0.3, 0.4], [1.0, 2.0], effects=effects, duration=0.2)
    assert np.isfinite(tl.simulate(scene).q).all()
    with pytest.raises(AccuracyError, match="cannot be solved so accurately"):
        tl.sensitivities(scene, wrt=["v"])


def test_they_reach_an_event_that_ends_the_run() -> None:
    """A second solution meets it a rounding before or behind the last sample."""
    ball = tl.load_scene("bouncing-ball").base
    landed = tl.effects.Watch("landed", when=tl.effects.FrameReaches("ball", 0.2), stop=True)
    for speed in np.linspace(0.1, 1.4, 14):
        s = tl.sensitivities(tl.Scene(ball, [1.0], [speed], [GRAVITY, landed]), wrt="v", duration=2.0, accuracy=1e-9)
        assert s.run.events[-1].t == s.run.t[-1]
        assert_near(s.q["v"][-1, 0, 0], s.run.t[-1], 1e-9)


def test_the_bar_is_not_far_above_the_error() -> None:
    scene = tl.load_scene("arm-swing")
    rough, exact = (
        tl.sensitivities(scene, wrt="q", duration=5.0, accuracy=accuracy, samples_per_second=20)
        for accuracy in (1e-5, 1e-10)
    )
    error = np.abs(np.concatenate([rough.q["q"] - exact.q["q"], rough.v["q"] - exact.v["q"]], axis=1)).max(axis=(1, 2))
    assert (error <= rough.error["q"] + exact.error["q"]).all()
    assert rough.error["q"][-1] <= 1e3 * error.max()


def test_names_that_mean_nothing_are_named() -> None:
    scene = tl.load_scene("arm-swing")
    with refusal(SceneError, code="unknown-parameter", match=r"forearm\.mass"):
        tl.sensitivities(scene, wrt=["forearm.mas"], duration=1.0)
    with pytest.raises(SceneError, match="names nothing"):
        tl.sensitivities(scene, wrt=[], duration=1.0)
    with pytest.raises(SceneError, match="wrt: expected texts, got 5"):
        tl.sensitivities(scene, wrt=5, duration=1.0)


def test_steep_friction_is_differentiable() -> None:
    """Differences of forces that change within 0.01 rad/s take steps far below that."""
    arm = tl.load_scene("arm-swing")
    scene = arm.with_effects([*arm.effects, tl.effects.SmoothFriction({"shoulder": 0.3})])
    s = tl.sensitivities(scene, wrt="q", duration=0.5, accuracy=1e-8, samples_per_second=10)
    truth = differences(scene, lambda shift: moved(scene, 0, shift), 1e-4, 0.5, 10, FOUR)
    require_within_bars(s, "q", truth, 1e-6)


def test_wrong_derivatives_are_refused() -> None:
    equations = equations_of(tl.load_scene("arm-swing"))
    code = variational_rate(equations, 1, 0).call
    certify_variation(equations, code, 1, 0)
    wrong = np.array([0, 0, 0, 0, 0, 0, 0, 1e-4])[:, None]
    with pytest.raises(CertificationError, match="differ"):
        certify_variation(equations, lambda rows: code(rows) * (1 + wrong), 1, 0)
