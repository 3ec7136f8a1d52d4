"""Sensors: true values at rest and in motion, resolution, noise and delay; with a controller and without."""

from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import ball
from tests.loop.loops import slider
from tests.urdf_text import joint, link, robot_of
from twolink.effects.sampled_control import exact
from twolink.errors import SceneError

E = tl.effects
RATE = {"period": 0.05}


def swing(*sensors: object, seconds: float = 1.0) -> tl.Trajectory:
    scene = tl.load_scene("arm-swing")
    effects = [*scene.effects, *sensors]
    return tl.simulate(tl.Scene(scene.base, scene.q, scene.v, effects), seconds, accuracy=1e-9, samples_per_second=20)


def test_true_values_are_those_of_pinocchio() -> None:
    """An IMU and a force-torque sensor against differences of poses and velocities, and against the weight at rest."""
    robot = tl.load_scene("arm-swing").robot
    link, joint, names = robot.frame_names[-1], robot.joint_names[0], robot.joint_names
    run = swing(E.Imu(link, **RATE), E.PoseSensor(link, **RATE), E.Encoder(names, **RATE),
                E.Tachometer(names, **RATE), E.TorqueSensor(names, **RATE), E.ForceTorque(joint, **RATE))  # fmt: skip
    assert list(run.sensors) == ["imu", "pose_sensor", "encoder", "tachometer", "torque_sensor", "force_torque"]
    read = {name: one.values for name, one in run.sensors.items()}
    assert np.array_equal(run.sensors["imu"].t, run.t)
    assert np.array_equal(read["encoder"], run.q)
    assert np.array_equal(read["tachometer"], run.v)
    assert np.array_equal(read["torque_sensor"], run.tau)
    model, data, h = run.robot.model, run.robot.model.createData(), 1e-4
    for k in (3, 11):
        t, place = run.t[k], model.getFrameId(link)
        poses = []
        for at in (t - h, t, t + h):
            pin.framesForwardKinematics(model, data, run.at(at)[0])
            poses.append(data.oMf[place].copy())
        turn = poses[1].rotation.T
        w = pin.log3(poses[0].rotation.T @ poses[2].rotation) / (2 * h)
        a = (poses[0].translation - 2 * poses[1].translation + poses[2].translation) / h**2
        assert read["imu"][k, :3] == pytest.approx(w, abs=1e-6)
        assert read["imu"][k, 3:] == pytest.approx(turn @ (a - model.gravity.linear), abs=1e-3)
        assert read["pose_sensor"][k, :3] == pytest.approx(poses[1].translation, abs=1e-12)
        wanted = pin.rnea(model, data, run.q[k], run.v[k], run.acceleration[k])
        assert read["force_torque"][k] @ model.joints[1].createData().S.ravel() == pytest.approx(wanted[0], abs=1e-9)


def test_a_link_may_have_the_name_of_another_ones_joint() -> None:
    """An IMU on the upper link reads the same, whatever the lower link's joint is called."""
    read = []
    for name in ("upper", "elbow"):
        robot = tl.load_robot(robot_of(
            link("upper"), link("lower"), joint("shoulder", "revolute", "ground", "upper", "0 1 0"),
            joint(name, "revolute", "upper", "lower", "0 1 0")))  # fmt: skip
        effects = [E.Gravity(), E.Imu("upper", name="imu", period=0.1)]
        read.append(tl.simulate(tl.Scene(robot, [0.3, 0.4], [1.0, 2.0], effects), 0.2).sensors["imu"].values)
    assert np.array_equal(*read)
    assert np.abs(read[0]).max() > 1.0


def test_readings_are_the_same_with_and_without_a_controller() -> None:
    """Noise by seed, name and tick; two seeds differ."""
    names = tl.load_scene("arm-swing").robot.joint_names
    idle = E.Controller(lambda _, y, s: (0.0 * y.encoder, s), period=0.1, inputs=("encoder",))
    noisy = {"noise": 1e-3, "walk": 1e-2, "bias": 0.1, **RATE}
    encoder = E.Encoder(names, **noisy)
    alone, again = swing(encoder).sensors["encoder"], swing(encoder).sensors["encoder"]
    looped = swing(encoder, idle).sensors["encoder"]
    assert np.array_equal(alone.values, again.values)
    assert np.array_equal(alone.t, looped.t)
    assert np.abs(alone.values - looped.values).max() < 1e-9
    other = swing(E.Encoder(names, seed=1, **noisy)).sensors["encoder"]
    assert np.abs(other.values - alone.values).max() > 1e-3


def test_noise_has_its_size_and_a_walk_grows() -> None:
    scene = tl.Scene(
        slider(), effects=[E.Encoder(("rail",), name="white", noise=0.2), E.Encoder(("rail",), name="drift", walk=0.3)]
    )
    run = tl.simulate(scene, 8.0)
    assert run.sensors["white"].values.std() == pytest.approx(0.2, rel=0.05)
    drift = run.sensors["drift"].values[:, 0]
    assert np.diff(drift).std() == pytest.approx(0.3 * np.sqrt(1e-3), rel=0.05)


def test_sensors_feel_what_is_held_until_it_is_released_with_a_controller_or_without() -> None:
    """A payload, then gravity itself: the wrench in a free elbow, and the specific force, by Pinocchio's models."""
    arm, payload = tl.load_robot("two_link"), E.Payload("forearm", 2.0, (0.3, 0.0, 0.0))
    idle = E.Controller(lambda _, y, s: (0.0 * y.v, s), period=0.1)
    for released, beside in ((payload, [E.Gravity()]), (E.Gravity(), [payload])):
        held = tl.Scene(arm, q=[1.2, 0.5], effects=[*beside, released]).robot
        effects = [*beside, E.Release(released, at=0.45), E.ForceTorque(joint="elbow", period=0.1),
                   E.Imu("forearm", period=0.1)]  # fmt: skip
        for loop in ([], [idle]):
            run = tl.simulate(tl.Scene(arm, q=[1.2, 0.5], effects=[*effects, *loop]), 0.8, samples_per_second=10)
            for k, (t, wrench) in enumerate(zip(run.t, run.sensors["force_torque"].values, strict=True)):
                model = (held if t < 0.45 else tl.Scene(arm, effects=beside).robot).model
                data, link = model.createData(), model.getFrameId("forearm")
                a = pin.aba(model, data, run.q[k], run.v[k], np.zeros(2))
                pin.rnea(model, data, run.q[k], run.v[k], a)
                assert wrench == pytest.approx(data.f[model.getJointId("elbow")].vector, abs=1e-6)
                pin.forwardKinematics(model, data, run.q[k], run.v[k], a)
                pin.updateFramePlacements(model, data)
                moving = pin.getFrameClassicalAcceleration(model, data, link, pin.LOCAL).linear
                felt = moving - data.oMf[link].rotation.T @ model.gravity.linear
                assert run.sensors["imu"].values[k, 3:] == pytest.approx(felt, abs=1e-6)


def test_resolution_and_delay_reach_the_controller() -> None:
    """q = t: read at 0.1 k with steps of 0.25, known 0.05 later, and asked for at 0.1 k."""
    seen = []
    control = E.Controller(
        lambda t, y, s: (seen.append((t, y.encoder[0])), ([0.0], s))[1], period=0.1, inputs=("encoder",)
    )
    encoder = E.Encoder(("rail",), period=0.1, delay=0.05, quantum=0.25)
    run = tl.simulate(tl.Scene(slider(), v=[1.0], effects=[control, encoder]), 1.0, verify=False)
    told = dict(seen)
    assert [told[k / 10] for k in range(11)] == [0.25 * round((k - 1) / 10 / 0.25) if k else 0.0 for k in range(11)]
    assert run.sensors["encoder"].values[3, 0] == 0.25


def test_a_period_may_be_a_fraction_as_that_of_a_controller() -> None:
    (sensor,) = tl.Scene(tl.load_robot("arm"), effects=[E.Encoder(("elbow",), period=Fraction(1, 3))]).effects
    assert exact(sensor.period) == Fraction(1, 3)


def test_touch_tells_links_apart_whose_shapes_have_the_same_names() -> None:
    """Two feet of 1 and 3 kg with a toe and a heel each; and what pairs and sums are called."""
    shape = '<collision name="{}"><origin xyz="{} 0 0"/><geometry><sphere radius="0.1"/></geometry></collision>'
    both = shape.format("toe", 0.2) + shape.format("heel", -0.2)
    feet = {"L": 1.0, "R": 3.0}
    robot = tl.load_robot(robot_of(*(link(foot, mass, 0.01, more=both) + joint(f"j{foot}", "prismatic", "ground", foot)
                                     for foot, mass in feet.items())))  # fmt: skip
    touch = [E.TouchSensor(foot, name=foot, period=0.05) for foot in feet]
    run = tl.simulate(tl.Scene(robot, [0.1, 0.1], effects=[E.Gravity(), E.Contact("ground"), *touch]), 0.2)
    assert list(run.contact_forces) == [f"{foot} {name} - ground" for foot in feet for name in ("toe", "heel")]
    for foot, mass in feet.items():
        assert run.sensors[foot].values[-1] == pytest.approx([0, 0, 9.81 * mass])
        assert run.contact_forces.on(foot)[-1] == pytest.approx([0, 0, 9.81 * mass])
        assert run.contact_forces.on(f"{foot} toe")[-1] == pytest.approx([0, 0, 9.81 * mass / 2])
    assert run.contact_forces.on("ground")[-1] == pytest.approx([0, 0, -9.81 * 4])
    alone = E.Contact((("L toe", "ground"),))
    assert [pair.name for pair in alone.selected(robot).chosen] == ["L toe - ground"]


def test_touch_feels_a_compliant_plane() -> None:
    """k s of a ball that is pressed in by s, at the start."""
    soft = E.CompliantContact("ball", stiffness=1e4, radius=0.1)
    scene = tl.Scene(ball(), [0, 0, 0.099, 0, 0, 0, 1], effects=[E.Gravity(), soft, E.TouchSensor("ball", period=0.05)])
    assert tl.simulate(scene, 0.1).sensors["touch_sensor"].values[0] == pytest.approx([0, 0, 10.0])


def test_touch_is_the_weight_of_what_rests_on_the_ground() -> None:
    scene = tl.load_scene("bouncing-ball")
    run = tl.simulate(scene.with_effects([*scene.effects, E.TouchSensor("ball", period=0.05)]))
    touch = run.sensors["touch_sensor"].values
    assert touch[0] == pytest.approx(0.0, abs=1e-12)
    assert touch[-1] == pytest.approx(-scene.robot.mass * scene.robot.model.gravity.linear)


def test_poses_are_inputs_of_controllers() -> None:
    def update(_: float, y: object, state: object) -> tuple[list[float], object]:
        return [-4.0 * y.cart[0, 3] - y["cart"][0, 3] * 0.0], state

    run = tl.simulate(tl.Scene(slider(), [1.0], effects=[E.Controller(update, period=0.05, inputs=("cart",))]), 0.5)
    same = E.Controller(lambda _, y, s: (-4.0 * y.q, s), period=0.05)
    other = tl.simulate(tl.Scene(slider(), [1.0], effects=[same]), 0.5)
    assert np.abs(run.q - other.q).max() < 1e-12


@pytest.mark.parametrize(
    "effects",
    [
        [E.Encoder(("road",))],
        [E.Encoder(("rail",)), E.Encoder(("rail",))],
        [E.Encoder(("rail",), name="q")],
        [E.Encoder(("rail",), period=0.0)],
        [E.Imu("road")],
        [E.ForceTorque("road")],
        [E.ForceTorque("rail"), E.PlaneContact("cart")],
        [E.ForceTorque("rail"), E.Release(E.PointLoop("cart"), at=5.0)],
    ],
)
def test_sensors_that_do_not_fit_are_refused(effects: list) -> None:
    with pytest.raises(SceneError):
        tl.Scene(slider(), effects=effects)
