"""Peers of the hard cases and of scripts/benchmarks/peers.py: what they share, what they lack, what ends a run."""

import functools
import importlib.util
import time

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from scripts.benchmarks.peers import (
    INTERVALS,
    Entry,
    compared_scenes,
    error_of,
    largest_difference,
    largest_growth,
    print_scene,
)
from tests.effects.bodies import ball
from tests.urdf_text import joint, link, robot_of
from twolink import effects as fx
from twolink.hard import SimulationCase, select_cases
from twolink.hard.attempts import run_peers
from twolink.hard.case import MET
from twolink.hard.peers import mujoco_peer, peer_module, scipy_peer, task
from twolink.hard.peers.task import PeerError, PeerRun, PeerTask, Setting, UnsupportedError, from_peer, task_of, to_peer
from twolink.hard.truths import extended_reference

TIMES = np.linspace(0.0, 0.5, 6)
TIGHT = {"scipy": Setting("DOP853", "tol 1e-12", 1e-12), "mujoco": Setting("RK4", "1 ms", step=1e-3)}
HAS_DRAKE = importlib.util.find_spec("pydrake") is not None  # the extra "peers" installs it
if HAS_DRAKE:
    TIGHT["drake"] = Setting("runge_kutta5", "accuracy 1e-10", 1e-10, 0.1)
TREE = """<robot name="tree"><link name="base"><inertial><mass value="2"/>
<inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>{links}</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial></link>
<joint name="j{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="0.2 0 0.1"
rpy="0.3 0.2 0.1"/><axis xyz="0 0.6 0.8"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"""


def tree(*kinds: str) -> str:
    """A floating base; the first and the last joint sit on it, the others each on the one before."""
    parents = ["base", *(f"l{k}" for k in range(len(kinds) - 2)), "base"]
    links = [LINK.format(name=f"l{k}", kind=kind, parent=parents[k]) for k, kind in enumerate(kinds)]
    return TREE.format(links="".join(links))


def floating_tree() -> tl.Scene:
    robot = tl.load_robot(tree("revolute", "continuous", "prismatic", "continuous"), root="free")
    random = np.random.default_rng(2)
    q = pin.integrate(robot.model, np.array(robot.neutral), random.uniform(-1, 1, robot.nv))
    springs = {"jl0": 3.0, "jl2": 20.0}
    effects = [fx.Gravity(), fx.JointSpring(springs, {"jl0": 0.4}), fx.JointDamping({"jl1": 0.2, "jl2": 1.0})]
    return tl.Scene(robot, q, random.uniform(-1, 1, robot.nv), effects)


@pytest.mark.parametrize("body_spin", [False, True])
def test_coordinates_there_and_back(body_spin: bool) -> None:
    scene = floating_tree()
    task = task_of(scene, TIMES)
    q, v = to_peer(task, body_spin=body_spin)
    assert len(q) == len(v) + 1
    track = from_peer(task, q[None], v[None], body_spin=body_spin)
    np.testing.assert_allclose(track.q[0], scene.q, atol=1e-15)
    np.testing.assert_allclose(track.v[0], scene.v, atol=1e-15)


@pytest.mark.parametrize("name", TIGHT)
def test_every_peer_moves_a_floating_tree_as_twolink_does(name: str) -> None:
    scene = floating_tree()
    try:
        module = peer_module(name)
    except ImportError as error:
        pytest.skip(str(error))
    ours = tl.simulate(scene, TIMES[-1], accuracy=1e-9, samples_per_second=10)
    track = module.prepare(task_of(scene, TIMES), TIGHT[name])().track
    np.testing.assert_allclose(track.q, ours.q, atol=1e-6)
    np.testing.assert_allclose(track.v, ours.v, atol=1e-5)


def test_what_peers_are_not_given_is_named() -> None:
    arm = tl.load_robot("two_link")
    with pytest.raises(UnsupportedError, match="SmoothFriction"):
        task_of(tl.Scene(arm, effects=[fx.SmoothFriction({"elbow": 0.5}, 0.1)]), TIMES)
    with pytest.raises(UnsupportedError, match="Planar"):
        task_of(tl.Scene(tl.load_robot(tree("planar", "revolute").replace('"0 0.6 0.8"', '"0 0 1"'))), TIMES)


def test_a_loop_is_found_on_links_that_have_the_names_of_joints() -> None:
    text = tree("revolute", "revolute", "revolute")
    loops = [
        task_of(tl.Scene(tl.load_robot(named), effects=[fx.PointLoop("l1", point_b=(0.4, 0.2, 0.3))]), TIMES).loops
        for named in (text, text.replace('joint name="j', 'joint name="'))
    ]
    for there, here in zip(loops[0][0], loops[1][0], strict=True):
        np.testing.assert_array_equal(there, here)


@pytest.mark.skipif(not HAS_DRAKE, reason="needs the extra peers")
def test_drakes_convex_integrator_stops_a_block_where_coulomb_does() -> None:
    rail = robot_of(
        joint("x", "prismatic", "ground", "cart", "1 0 0"), link("cart", 1e-3, 1e-3),
        joint("z", "prismatic", "cart", "block"), link("block", 1.0, 1e-3))  # fmt: skip
    contact = fx.Contact((("block", "ground"),), 0.3, shapes={"block": (fx.Box((0.4, 0.3, 0.2)),)})
    task = task_of(tl.Scene(tl.load_robot(rail), [0, 0.1], [2.0, 0], [fx.Gravity(), contact]), np.array([0.0, 1.0]))
    drake = peer_module("drake")
    (setting,) = [setting for setting in drake.usual_settings(task) if setting.method == "cenic"]
    stops = 2.0**2 / (2 * 0.3 * 9.81 / 1.001)  # the cart moves along and presses on nothing
    assert drake.prepare(task, setting)().track.q[-1, 0] == pytest.approx(stops, abs=1e-3)


def test_a_state_that_is_not_finite_is_the_peers_own_error() -> None:
    scene = tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity(), fx.JointSpring({"elbow": 1e9})], q=[0, 1.0])
    with pytest.raises(PeerError, match="unstable"):
        mujoco_peer.prepare(task_of(scene, TIMES), Setting("RK4", "0.1 s", step=0.1))()


def test_a_run_is_ended_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "MAX_SECONDS", 0.2)
    start = time.monotonic()
    with pytest.raises(UnsupportedError, match="not at the end"):
        task.run_limited(lambda: time.sleep(60))
    assert time.monotonic() - start < 10


def test_a_run_that_fails_is_reported_with_its_words() -> None:
    def fail() -> PeerRun:
        raise ValueError("the plant is on fire")

    with pytest.raises(PeerError, match="on fire"):
        task.run_limited(fail)


def test_peers_of_a_case_are_judged_by_its_truth() -> None:
    (case,) = select_cases(["torque-steps"])
    assert isinstance(case, SimulationCase)
    attempts = list(run_peers(case, case.load()))
    assert [name for name, _ in attempts] == ["SciPy", "SciPy", "MuJoCo", "MuJoCo"]
    assert all(a.verdict == MET and a.curve is not None for _, a in attempts)
    assert [a.default for _, a in attempts] == [True, False, True, False]


def test_mujoco_sees_a_convex_shape_as_the_box_that_it_is() -> None:
    """It falls on an edge and tips over: beside a box by MuJoCo's own detection of meshes."""
    pytest.importorskip("mujoco")
    corners = tuple((x, y, z) for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1))
    ends = []
    for shape in (fx.Box((0.6, 0.4, 0.2)), fx.Convex(corners)):
        contact = fx.Contact(("ground",), 0.5, shapes={"ball": (shape,)})
        scene = tl.Scene(ball(), [0, 0, 0.4, 0.28, 0, 0, 0.96], effects=[fx.Gravity(), contact])
        ends.append(peer_module("mujoco").prepare(task_of(scene, TIMES), Setting("Euler", "1 ms", step=1e-3))().track.q)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)
    assert np.abs(ends[0][-1, :3] - ends[0][0, :3]).max() > 0.05


@functools.cache
def asked(name: str) -> PeerTask:
    """What the peers are asked to do in a scene."""
    scene, end = compared_scenes()[name]
    return task_of(scene, np.linspace(0, end, INTERVALS + 1))


@pytest.mark.parametrize("name", compared_scenes())
def test_mujocos_models_accelerate_as_pinocchio_says(name: str) -> None:
    aba, forward = scipy_peer.accelerations(asked(name)), mujoco_peer.accelerations(asked(name))
    assert largest_difference(asked(name), forward, aba) < 1e-12


TWICE = {
    "torques": ([fx.Torque({"elbow": 2.0}), fx.Torque({"elbow": fx.Sine(3.0, 1.0)})], set()),
    "springs": ([fx.JointSpring({"elbow": 20.0}), fx.JointSpring({"elbow": 30.0}, {"elbow": 1.0})], set()),
    "damping": ([fx.JointDamping({"elbow": 1.0}), fx.JointDamping({"elbow": 2.0})], set()),
    "friction": ([fx.DryFriction({"elbow": 1.0}), fx.DryFriction({"elbow": 1.5})], {"scipy"}),
}  # fmt: skip


@pytest.mark.parametrize("kind", TWICE)
def test_effects_of_one_kind_add_up(kind: str) -> None:
    effects, lacks = TWICE[kind]
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[fx.Gravity(), *effects])
    ours, task = tl.simulate(scene, t_eval=TIMES), task_of(scene, TIMES)
    for name, setting in (("scipy", Setting("DOP853", "", 1e-10)), ("mujoco", Setting("Euler", "", step=1e-4))):
        if name not in lacks:
            run = peer_module(name).prepare(task, setting)()
            off = {"scipy": 1e-7, "mujoco": 1e-2 if kind == "friction" else 3e-3}  # whose friction is soft
            np.testing.assert_allclose(run.track.q, ours.q, atol=off[name])


def test_a_free_body_is_damped_in_all_its_directions() -> None:
    """v' = -d v / m, and the spin about a main axis decays by d / I."""
    scene = tl.Scene(ball(2.0, 0.5), v=[1.0, 0, 0, 0, 0, 3.0], effects=[fx.JointDamping({"root_joint": 0.7})])
    expected = np.array([np.exp(-0.35 * TIMES), 3.0 * np.exp(-1.4 * TIMES)]).T
    for name, setting in (("scipy", Setting("DOP853", "", 1e-10)), ("mujoco", Setting("Euler", "", step=1e-4))):
        v = peer_module(name).prepare(task_of(scene, TIMES), setting)().track.v
        speeds = np.array([np.linalg.norm(v[:, :3], axis=1), v[:, 5]]).T
        np.testing.assert_allclose(speeds, expected, atol=1e-3 if name == "mujoco" else 1e-8)


def test_effects_that_the_scene_lacks_are_off_in_mujoco() -> None:
    model = mujoco_peer.build(asked("panda"))
    assert not model.dof_damping.any()
    assert not model.dof_armature.any()
    assert not model.jnt_limited.any()
    for name in ("CONTACT", "LIMIT", "CONSTRAINT", "SPRING", "DAMPER"):
        if flag := getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0):
            assert model.opt.disableflags & flag, name


def test_the_reference_is_close_to_every_peer() -> None:
    scene, _ = compared_scenes()["arm-swing"]
    swing = asked("arm-swing")
    reference, doubt = extended_reference(scene, swing.times)
    assert reference.shape == (INTERVALS + 1, 2)
    assert np.array_equal(reference[0], scene.q)
    assert doubt[-1] < 1e-15
    assert largest_growth(scene, swing.times, reference) < 100
    settings = [Setting(method, "tol 1e-8", 1e-8) for method in scipy_peer.METHODS if method != "Radau"]
    errors = {s.method: error_of(scipy_peer.prepare(swing, s)().track.q, reference) for s in settings}
    runge_kutta = [s for s in mujoco_peer.all_settings(swing, coarse=True) if s.method == "RK4"][6]
    errors["MuJoCo RK4"] = error_of(mujoco_peer.prepare(swing, runge_kutta)().track.q, reference)
    assert max(errors.values()) < 1e-5, errors


def test_settings_go_from_rough_to_fine() -> None:
    for module in (scipy_peer, mujoco_peer):
        coarse, fine = (module.all_settings(asked("ur5"), coarse) for coarse in (True, False))
        assert len(fine) > 1.8 * len(coarse)
        for method in {s.method for s in fine}:
            values = [s.tolerance or s.step for s in fine if s.method == method]
            assert values == sorted(values, reverse=True)


def test_the_summary_says_what_is_met(capsys: pytest.CaptureFixture[str]) -> None:
    def entry(who: str, error: float, seconds: float) -> Entry:
        return Entry("arm-swing", who, "accuracy 1e-03", error, seconds, None, 3)

    peers = [entry("SciPy RK45", 1e-4, 0.5), entry("Drake radau3", 1e-7, 1.0)]
    print_scene([*peers, entry("twolink", 1e-7, 0.02), entry("twolink, verified", 1e-7, 0.05)], doubt=1e-17)
    lines = capsys.readouterr().out.splitlines()
    verdicts = {line.split()[0]: line for line in lines if line.strip().startswith("1e-")}
    assert verdicts["1e-03"].endswith("25.0 20x met")
    assert verdicts["1e-06"].endswith("50.0 40x met")
    assert verdicts["1e-09"].endswith("50x missed")
    assert lines[-1].endswith("1e-03 2.50; bar 3x met")
