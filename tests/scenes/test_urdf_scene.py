"""A scene with all that a URDF says."""

import pickle

import numpy as np
import pytest

import twolink as tl
import twolink.effects as fx
from tests.urdf_text import link
from twolink.cli.scenes import limit_notes
from twolink.errors import RobotError, SceneError

ARM = """<robot name="r">
  <link name="base"/>{}{}
  <joint name="p" type="revolute"><parent link="base"/><child link="a"/><axis xyz="{{axis}}"/>
    <limit lower="0.2" upper="1" effort="3" velocity="1"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="m" type="revolute"><parent link="a"/><child link="b"/><axis xyz="{{axis}}"/><origin xyz="0 0 -1"/>
    <limit lower="-9" upper="9" effort="0" velocity="0"/><mimic joint="p" multiplier="2" offset="0.1"/></joint>
</robot>""".format(*(link(name, 1.0, 0.1, "0 0 -0.5") for name in "ab"))


def test_all_that_the_urdf_says_acts_and_is_listed() -> None:
    scene = tl.scene_of(tl.load_robot(ARM.format(axis="0 1 0")))
    kinds = [type(effect).__name__ for effect in scene.effects]
    assert kinds == ["Gravity", "JointDamping", "DryFriction", "JointStops", "Coupling"]
    np.testing.assert_allclose(scene.q, [0.2 + 0.6 * 0.8, 2 * 0.68 + 0.1])
    assert not scene.notes()
    told = str(scene)
    for words in ("damping", "friction", "limits of position", "mimic", "gravity", "limits of effort"):
        assert words in told
    assert {f.names for f in scene.report.read} >= {("p",), ("m",)}
    again = pickle.loads(pickle.dumps(scene))
    assert str(again) == told
    assert np.array_equal(tl.scene_of(scene.base).q, scene.q)


@pytest.mark.parts
def test_a_coupling_moves_as_a_robot_with_mimic_joints_which_no_run_takes() -> None:
    q, v = np.array([0.5, 1.1]), np.array([0.3, 0.6])
    text = ARM.format(axis="0 1 0")
    coupled, robot = tl.load_robot(text, mimic=True), tl.load_robot(text)
    scene = tl.Scene(robot, q, v, effects=[fx.Gravity(), fx.Coupling("m", "p", 2.0, 0.1)])
    expected = coupled.forward_dynamics(q[:1], v[:1], [0.0])[0]
    np.testing.assert_allclose(tl.simulate(scene, 0.1).acceleration[0], [expected, 2 * expected], rtol=1e-9)
    for ask in (lambda s: tl.simulate(s, 0.1), lambda s: tl.simulate_many(s, 0.1, q=[q[:1]]), tl.Simulation,
                tl.linearize, lambda s: tl.sensitivities(s, 0.1)):  # fmt: skip
        with pytest.raises(SceneError, match=r"fx\.Coupling, or take tl\.scene_of of the file") as caught:
            ask(tl.Scene(coupled, q[:1], v[:1]))
        assert caught.value.code == "mimic-joints"


def test_the_run_keeps_the_limits_and_the_coupling_and_says_where_it_is_too_fast() -> None:
    scene = tl.scene_of(tl.load_robot(ARM.format(axis="0 1 0")))
    run = tl.simulate(scene, 1.0)
    assert run.q[:, 0].min() >= 0.2 - 1e-9
    np.testing.assert_allclose(run.q[:, 1], 2 * run.q[:, 0] + 0.1, atol=1e-9)
    speed = np.abs(run.v[:, 0]).max()
    notes = limit_notes(run)
    assert len(notes) == (speed > 1)
    assert notes == [] or f"{speed:.4g} at most" in notes[0]


def test_notes_on_limits_look_between_samples_and_at_what_is_farthest() -> None:
    """It passes its lower limit of 0.2 at 0.2 s, and goes on towards 0."""
    robot = tl.load_robot(ARM.format(axis="0 0 1"))
    scene = tl.Scene(robot, [0.3, 0.6], [-0.5, -0.5], [])
    for t_eval in ([0.0, 0.5], [0.5]):
        first, *_ = limit_notes(tl.simulate(scene, 0.5, t_eval=t_eval))
        assert first == "p is beyond its limit of 0.2 rad from 0.201 s on: 0.05 at least"


def test_a_robot_that_gravity_does_not_move_starts_with_a_speed() -> None:
    scene = tl.scene_of(tl.load_robot(ARM.format(axis="0 0 1")))
    assert scene.v.tolist() == [0.5, 1.0]
    assert "gravity alone moves nothing" in str(scene)


def test_a_file_without_its_meshes_gives_a_scene_and_its_report() -> None:
    lost = '<collision><geometry><mesh filename="package://lost/arm.stl"/></geometry></collision>'
    urdf = (
        f'<robot name="arm"><link name="ground"/>{link("a", 1.0, 0.1, more=lost)}'
        '<joint name="j" type="continuous"><parent link="ground"/><child link="a"/><axis xyz="0 1 0"/></joint></robot>'
    )
    said = str(tl.scene_of(urdf).report)
    assert "no body touches another, no motor acts" in said
    with pytest.raises(RobotError, match=r"lost/arm\.stl' was not found; give package_dirs=, or shapes= to Contact"):
        tl.scene_of(urdf, contact=True)


def test_a_robot_without_joints_is_refused() -> None:
    with pytest.raises(SceneError, match="no joint moves") as failure:
        tl.scene_of("spinning_box")
    assert failure.value.code == "nothing-moves"


def test_starts_of_the_catalogue_are_within_limits_and_off_equilibrium() -> None:
    for name in ("panda", "kinova", "go1", "talos_arm", "tiago_no_hand", "bowler"):
        scene = tl.scene_of(name)
        assert not scene.notes(), name
        torque = scene.robot.gravity_torque(scene.q)
        assert np.any(np.abs(torque) > scene.robot.model.friction) or scene.v.any(), name


@pytest.mark.parametrize(("kind", "lock"), [("revolute", {"p": 0.3}), ("continuous", {})])
def test_mimic_joints_that_are_not_coupled_are_named(kind: str, lock: dict[str, float]) -> None:
    text = ARM.format(axis="0 1 0").replace('type="revolute"', f'type="{kind}"')
    scene = tl.scene_of(tl.load_robot(text, lock=lock))
    assert not any(isinstance(effect, fx.Coupling) for effect in scene.effects)
    (finding,) = (one for one in scene.report.ignored if one.what.startswith("mimic"))
    assert finding.names == ("m = 2 p + 0.1",)
    coupled = tl.scene_of(tl.load_robot(ARM.format(axis="0 1 0")))
    assert not any(one.what.startswith("mimic") for one in coupled.report.ignored)


@pytest.mark.parametrize("lock", [{"p": 0.3}, {"m": 0.7}])
def test_couplings_with_a_locked_joint_are_named(lock: dict[str, float]) -> None:
    """Of a URDF and of an MJCF: the other joint moves freely, as alone."""
    mjcf = """<mujoco><worldbody><body name="a"><joint name="p" axis="0 1 0"/><geom size="0.1" pos="0 0 -.5"/>
        <body name="b" pos="0 0 -1"><joint name="m" axis="0 1 0"/><geom size="0.1" pos="0 0 -.5"/></body></body>
        </worldbody><equality><joint joint1="m" joint2="p" polycoef=".1 2 0 0 0"/></equality></mujoco>"""
    for text in (ARM.format(axis="0 1 0"), mjcf):
        scene = tl.scene_of(tl.load_robot(text, lock=lock))
        assert not any(isinstance(effect, fx.Coupling) for effect in scene.effects)
        (finding,) = (one for one in scene.report.ignored if one.what.startswith("mimic"))
        assert finding.names == ("m = 2 p + 0.1",)
        assert tl.simulate(scene, 0.1).error is not None
