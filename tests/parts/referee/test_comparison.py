"""Another simulator's log beside the solution: MuJoCo's laws are those of the scene, and its default step is found."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call
from tests.parts.exchange.simulators import law_of, stepped
from twolink import effects as fx
from twolink.errors import SceneError
from twolink.hard.peers import mujoco_peer, peer_module
from twolink.hard.peers.task import Setting, UnsupportedError, task_of
from twolink.parts.referee.comparison import compare

SLIDERS = """<robot name="sliders"><link name="base"/>{links}</robot>"""
SLIDER = """<link name="l{k}"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="j{k}" type="prismatic"><parent link="base"/><child link="l{k}"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="{upper}" effort="9" velocity="9"/>
<dynamics damping="{damping}" friction="{friction}"/></joint>"""


def sliders(*given: tuple[float, float, float]) -> tl.Scene:
    """Bodies of 2 kg that slide at 1 m/s from 0: upper stop, damping, friction."""
    links = (SLIDER.format(k=k, upper=upper, damping=d, friction=f) for k, (upper, d, f) in enumerate(given))
    robot = tl.load_robot(SLIDERS.format(links="".join(links)))
    return tl.Scene(robot, robot.neutral, np.ones(robot.nv), [fx.JointStops(), fx.JointDamping(), fx.DryFriction()])


def test_mujoco_has_the_damping_friction_and_stops_of_a_urdf() -> None:
    scene, times = sliders((9, 0.5, 0.1), (9, 0.1, 1.5), (0.5, 0.1, 0.1)), np.linspace(0, 3, 301)
    track = mujoco_peer.prepare(task_of(scene, times), Setting("RK4", "", step=1e-4))().track
    # m v' = -d v - f, until it rests
    for k, (d, f) in enumerate(((0.5, 0.1), (0.1, 1.5))):
        rest = 2 / d * np.log(1 + d / f)
        moving = np.minimum(times, rest)
        x = 2 / d * ((1 + f / d) * (1 - np.exp(-d * moving / 2)) - f / 2 * moving)
        np.testing.assert_allclose(track.q[:, k], x, atol=2e-3)
    hit = times[np.argmax(track.q[:, 2] > 0.4999)]
    assert hit == pytest.approx(0.52, abs=0.03)
    assert 0.5 < track.q[:, 2].max() < 0.53
    ours = tl.simulate(scene, 3.0, t_eval=times)
    np.testing.assert_allclose(track.q[:, :2], ours.q[:, :2], atol=2e-3)


def test_a_coupling_holds_in_mujoco() -> None:
    free = sliders((9, 0.1, 0.1), (9, 0.1, 0.1))
    scene = tl.Scene(free.base, free.q, [2.0, 1.0], [fx.Coupling("j0", "j1", 2.0)])
    track = mujoco_peer.prepare(task_of(scene, np.linspace(0, 1, 11)), Setting("RK4", "", step=1e-3))().track
    np.testing.assert_allclose(track.q[:, 0], 2 * track.q[:, 1], atol=1e-4)
    assert track.q[-1, 1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_the_default_step_of_mujoco_is_found() -> None:
    scene = tl.load_scene("arm-swing")
    found = compare(scene, "mujoco", 1.0)
    by_hand = stepped(scene, law_of(scene.robot), 1.0, 0.002, 0.002)
    np.testing.assert_allclose(found.log.q, by_hand[1], atol=1e-9)  # another program, the same steps
    assert "semi-implicit Euler with steps of 2 ms" in str(found.verdict.causes[0])
    since = found.verdict.beyond["0.001"]
    distance = np.abs(by_hand[1] - tl.simulate(scene, 1.0, t_eval=by_hand[0]).q).max(axis=1)
    assert since == pytest.approx(by_hand[0][np.argmax(distance > 1e-3)], abs=1e-9)
    assert f"MuJoCo {mujoco_peer.VERSION} (Euler, default: 2 ms) is within 0.001 rad until {since:.4g} s" in str(found)
    assert found.ours.error.max() < 1e-7
    assert found.seconds > 0


@pytest.mark.parametrize(("effect", "part"), [
    (fx.DryFriction({"j0": 1.0}, {"j0": 2.0}), "static friction"),
    (fx.JointStops({"j0": (-1, 1)}, 0.5), "restitution"), (fx.FrameWrench("l0", (1, 0, 0)), "not modelled"),
])  # fmt: skip
def test_what_a_peer_has_not_is_named(effect: fx.Effect, part: str) -> None:
    scene = sliders((9, 0.1, 0.1))
    with pytest.raises(SceneError, match=part) as caught:
        compare(scene.with_effects([effect]), "mujoco", 0.1)
    assert caught.value.code == "no-peer"


def test_other_peers_do_not_soften() -> None:
    for scene, peer, part in (
        (sliders((9, 0.1, 0.1)), "scipy", "it does not simulate dry friction, stops"),
        (tl.load_scene("box-stack"), "scipy", "SciPy: it does not simulate contacts"),
    ):
        with pytest.raises(SceneError, match=part) as caught:
            compare(scene, peer, 0.1)
        assert caught.value.code == "no-peer"
    with pytest.raises(SceneError, match="mujoco"):
        compare(sliders((9, 0.1, 0.1)), "mujocco", 0.1)
    with pytest.raises(SceneError, match="duration"):
        compare(tl.load_scene("arm-swing"), "scipy", -1.0)
    assert compare(tl.load_scene("arm-swing"), "scipy", 0.5).peer.startswith("SciPy")


@pytest.mark.parametrize("peer", ["scipy", "drake"])
def test_every_peer_refuses_by_name_what_it_does_not_simulate(peer: str) -> None:
    """Each part of a task that is not in its list, also one that is added later."""
    try:
        module = peer_module(peer)
    except ImportError as error:
        pytest.skip(str(error))
    plain = task_of(tl.load_scene("arm-swing"), np.linspace(0.0, 0.1, 3))
    assert not plain.needs
    parts = {one.name for one in fields(plain)} - {"robot", "q", "v", "times", "joints", "options"}
    assert parts > {"contacts", "stops"}
    setting = module.usual_settings(plain)[0]
    for part in parts - module.SIMULATES:
        used = {"j": 1.0} if isinstance(getattr(plain, part), dict) else ("anything",)
        with pytest.raises(UnsupportedError, match="it does not simulate"):
            module.prepare(replace(plain, **{part: used}), setting)


FILE = """<mujoco><compiler angle="radian"/><option timestep="{step}" integrator="{method}"/><worldbody>
<body pos="0 0 1"><joint name="j1" axis="0 1 0" damping="{damping}"/>
<geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/>
<body pos="0.5 0 0"><joint name="j2" axis="0 1 0" damping="{damping}" {more}/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="0.7"/></body></body></worldbody></mujoco>"""


def test_mujoco_runs_a_file_with_the_files_own_options(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(FILE.format(step=2e-4, method="RK4", damping=0.05, more=""))
    fine = compare(tl.scene_of(path), "mujoco", 0.5)
    assert fine.setting == "RK4, options of its file: 0.2 ms"
    assert fine.verdict.right  # of order 4: 0.2 ms leaves about 1e-13
    path.write_text(FILE.format(step=5e-3, method="implicitfast", damping=0.05, more=""))
    coarse = compare(tl.scene_of(path), "mujoco", 0.5)
    assert np.allclose(np.diff(coarse.log.t), 5e-3)
    (cause,) = coarse.verdict.causes
    assert cause.what == "semi-implicit Euler with implicit damping with steps of 5 ms"


def test_soft_friction_and_soft_contact_are_causes() -> None:
    pytest.importorskip("mujoco")
    rubbed = compare(sliders((9, 0.5, 1.5)), "mujoco", 2.0)  # it creeps where Coulomb's friction holds
    stacked = compare(tl.load_scene("box-stack"), "mujoco", 0.3)
    for found, words in ((rubbed, "friction"), (stacked, "soft contacts")):
        assert found.verdict.answer == "wrong"
        assert len(found.verdict.causes) == 1
        assert words in found.verdict.causes[0].what or "Euler" in found.verdict.causes[0].what
    assert stacked.verdict.causes[0].what.startswith("MuJoCo's soft contacts")


@pytest.mark.slow
def test_the_command_writes_picture_verdict_and_log(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("x.png", "x.json", "x.mcap")]
    record = answer("compare", "arm-swing", "--duration", "0.2", *(x for file in files for x in ("--out", str(file))))
    assert record["verdict"]["right"] is False
    assert files[0].stat().st_size > 10_000
    assert json.loads(files[1].read_text())["peer"].startswith("MuJoCo")
    assert not tl.judge(tl.load_scene("arm-swing"), files[2]).right
    assert call("compare", "arm-swing", "--with", "ode").returncode == 2


def test_drake_runs_a_loop_to_the_world_at_its_usual_step() -> None:
    pytest.importorskip("pydrake", reason="the extra `peers` is not installed")
    found = compare(tl.load_scene("heavy-top"), "drake", 0.02)
    assert "1 ms" in found.setting
    assert not found.verdict.right
    assert 1e-5 < found.verdict.distance.max() < 1e-2
