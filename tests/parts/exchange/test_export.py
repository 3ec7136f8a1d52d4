"""Robots as C and as URDF: compiled and run, loaded again and compared."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.command import TOP
from twolink import effects as fx
from twolink.errors import QueryError, SceneError, TwolinkError
from twolink.lagrange.check import arm_urdf
from twolink.robots.collisions import Solid

ROBOTS = ("two_link", "panda", "ur5", "kinova", "z1", "double_pendulum_continuous", "solo12", "go1", "anymal", "bowler")
SIMILAR = ("ur5", "z1", "go1", "solo12", "bowler")  # to others of these
STATES = 100
STRICT = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
FREE = {"solo12": "free", "anymal": "free"}


def library(source: Path) -> ctypes.CDLL:
    """The compiled file."""
    out = source.with_suffix(".so")
    subprocess.run([*STRICT, "-O1", "-shared", "-fPIC", "-o", str(out), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(out))


def call(function: object, size: int, *arguments: np.ndarray | float) -> np.ndarray:
    out = np.empty(size)
    given = [ctypes.c_double(x) if np.ndim(x) == 0 else np.ascontiguousarray(x).ctypes.data_as(ctypes.c_void_p)
             for x in arguments]  # fmt: skip
    function(*given, out.ctypes.data_as(ctypes.c_void_p))
    return out


@pytest.mark.some(3)
@pytest.mark.parametrize("name", ROBOTS)
def test_c_agrees_with_pinocchio(name: str, tmp_path: Path) -> None:
    robot = tl.load_robot(name, root=FREE.get(name, "fixed"))
    source, _ = robot.export_c(tmp_path / "it.c", ["forward_dynamics", "mass_matrix", "bias"])
    lib, nv = library(source), robot.nv
    q, v = robot.random_state(STATES, seed=5)
    tau = np.random.default_rng(5).normal(size=v.shape)
    a = robot.forward_dynamics(q, v, tau, engine="pinocchio")
    matrix, bias = robot.mass_matrix(q, engine="pinocchio"), robot.bias(q, v, engine="pinocchio")
    for i in range(STATES):
        got = call(lib.it_forward_dynamics, nv, q[i], v[i], tau[i])
        solved = matrix[i] @ got - (tau[i] - bias[i])  # what remains of M a = tau - h: free of M's condition number
        assert np.abs(solved).max() <= 1e-12 * max(np.abs(matrix[i]) @ np.abs(a[i]) + np.abs(bias[i]) + 1)
        np.testing.assert_allclose(call(lib.it_mass_matrix, nv * nv, q[i]), matrix[i].ravel(), rtol=0,
                                   atol=1e-12 * np.abs(matrix[i]).max())  # fmt: skip
        np.testing.assert_allclose(call(lib.it_bias, nv, q[i], v[i]), bias[i], rtol=0,
                                   atol=1e-12 * max(1, np.abs(bias[i]).max()))  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("flags", [[], ["-DTWOLINK_FLOAT"]])
@pytest.mark.parametrize("name", ["two_link", "kinova"])
def test_the_self_test_passes_and_finds_a_changed_number(name: str, flags: list[str], tmp_path: Path) -> None:
    robot = tl.load_robot(name)
    functions = ["forward_dynamics", "inverse_dynamics", f"frame_pose:{robot.frame_names[-1]}", "energy", "step:rk4"]
    source, header = robot.export_c(tmp_path / "my-arm.c", functions)
    assert "96 states against the reference" in header.read_text()

    def run() -> subprocess.CompletedProcess[str]:
        options = [*flags, "-DMY_ARM_SELF_TEST", "-o", str(tmp_path / "test")]
        subprocess.run([*STRICT, *options, str(source), "-lm"], check=True)
        return subprocess.run([str(tmp_path / "test")], capture_output=True, text=True, check=False)

    done = run()
    assert done.returncode == 0, done.stdout
    assert all(function in done.stdout for function in functions)
    text = source.read_text()
    place = text.index("out[0] = ", text.index("my_arm_inverse_dynamics")) + len("out[0] = ")
    source.write_text(f"{text[:place]}K(1e6) + {text[place:]}")
    assert run().returncode == 1


@pytest.mark.parametrize("by", ["c++", "cmake"])
def test_a_program_in_cpp_calls_it(by: str, tmp_path: Path) -> None:
    """The example of the documentation, whose linker knows the names of C by the header alone."""
    if shutil.which(by) is None or shutil.which("c++") is None:
        pytest.skip(f"needs {by}")
    robot = tl.load_robot("two_link")
    source, _ = robot.export_c(tmp_path / "arm.c", ["inverse_dynamics"])
    for file in (TOP / "docs/examples/cpp").iterdir():
        shutil.copy(file, tmp_path)
    commands = {"c++": [["cc", "-c", str(source), "-o", "arm.o"], ["c++", "torque.cpp", "arm.o", "-o", "torque"]],
                "cmake": [["cmake", "."], ["cmake", "--build", "."]]}  # fmt: skip
    for command in commands[by]:
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    told = subprocess.run([str(tmp_path / "torque")], capture_output=True, text=True, check=True).stdout.split()
    assert [float(x) for x in told[:2]] == pytest.approx(robot.gravity_torque([0.3, 0.5]), abs=1e-11)


def test_the_step_is_the_method_of_its_order(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    source, _ = robot.export_c(tmp_path / "arm.c", ["step:rk4"])
    step, q, v = library(source).arm_step_rk4, np.array([0.3, 0.5]), np.array([0.5, -1.0])
    gravity = fx.Gravity(tuple(robot.gravity))
    truth = tl.simulate(tl.Scene(robot, q, v, [gravity]), 0.5, accuracy=1e-11, t_eval=[0.5])
    errors = []
    for n in (80, 160):
        x = np.concatenate([q, v])
        for _ in range(n):
            x = call(step, 4, x[:2], x[2:], np.zeros(2), 0.5 / n)
        errors.append(np.abs(x - np.concatenate([truth.q[-1], truth.v[-1]])).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    usual, start = library(robot.export_c(tmp_path / "bar.c", ["step"])[0]).bar_step, (q, v, np.zeros(2), 0.01)
    assert np.array_equal(call(usual, 4, *start), call(step, 4, *start))


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    for functions in ([], "energy", ["energy", "energy"], ["centre_of_mass"], ["step:radau"], ["step:gauss4"],
                      ["step_euler"], ["stepper"], ["step:auto"]):  # fmt: skip
        with pytest.raises(TwolinkError) as caught:
            robot.export_c(tmp_path / "x.c", functions)
        assert "did you mean 'auto'" not in str(caught.value)
    with pytest.raises(QueryError, match="no joint moves"):
        tl.load_robot("heavy_top").export_c(tmp_path / "x.c")
    with pytest.raises(TwolinkError):
        robot.export_c(tmp_path / "x.txt")
    assert list(tmp_path.iterdir()) == []


def test_frames_alone_of_a_robot_without_inertia_are_written(tmp_path: Path) -> None:
    robot = tl.load_robot("""<robot name="r"><link name="w"/><link name="a"/><joint name="j" type="prismatic">
        <parent link="w"/><child link="a"/><limit lower="0" upper="2" effort="1" velocity="1"/></joint></robot>""",
        purpose="kinematics")  # fmt: skip
    source, _ = robot.export_c(tmp_path / "r.c", ["frame_pose:a"])
    assert call(library(source).r_frame_pose_a, 12, 0.7)[9:] == pytest.approx([0.7, 0.0, 0.0])
    with pytest.raises(QueryError, match="move no inertia"):
        robot.export_c(tmp_path / "r.c", ["frame_pose:a", "forward_dynamics"])


def test_no_name_ends_a_comment(tmp_path: Path) -> None:
    text = (tl.load_robot("two_link").visuals.text).replace('"two_link"', '"two*/link é"', 1)
    source, _ = tl.load_robot(text).export_c(tmp_path / "1arm.c")
    assert library(source)._1arm_forward_dynamics


@pytest.mark.some(9)
@pytest.mark.parametrize(("name", "lock"), [
    ("panda", {"panda_joint3": 0.4, "panda_finger_joint1": 0.02}),  # which are merged
    *((name, {}) for name in sorted([*ROBOTS, "talos_arm", "tiago_pro", "baxter"], key=SIMILAR.__contains__)),
])  # fmt: skip
def test_an_exported_urdf_is_the_same_robot(name: str, lock: dict[str, float], tmp_path: Path) -> None:
    root = FREE.get(name, "fixed")
    robot = tl.load_robot(name, root=root, lock=lock)
    again = tl.load_robot(robot.export_urdf(tmp_path / "r.urdf"), root=root)
    found = tl.compare_models(robot, again)
    assert found.equal, str(found)
    assert not found.remarks or "would mirror" in found.remarks[0]
    assert max(found.dynamics.values()) < 1e-9
    assert set(robot.frame_names) == set(again.frame_names)
    assert again.nv == robot.nv


def test_a_run_for_matlab_is_read_again(tmp_path: Path) -> None:
    from scipy.io import loadmat

    for name in ("two_link", "double_pendulum_continuous", "bouncing_ball"):
        scene = tl.Scene(tl.load_robot(name), effects=[fx.Gravity()])
        run = tl.simulate(scene, 0.1)
        path = run.save(tmp_path / f"{name}.mat")
        arrays = loadmat(path)
        assert arrays["q"].shape == run.q.shape
        assert arrays["t"].shape == (len(run.t), 1)
        assert len(arrays["v_names"].ravel()) == scene.robot.nv
        again = tl.Trajectory.load(path)
        np.testing.assert_array_equal(again.q, run.q)
        np.testing.assert_array_equal(again.error, run.error)
        assert tl.judge(scene, path).right
    one = tl.simulate(scene, 0.1, t_eval=[0.1])
    np.testing.assert_array_equal(tl.Trajectory.load(one.save(tmp_path / "one.mat")).q, one.q)


@pytest.mark.slow
def test_the_example_in_matlab_runs_in_octave(tmp_path: Path) -> None:
    """Its equations are the arm's: ode45 at 1e-10 is right, at MATLAB's defaults it is not."""
    if shutil.which("octave") is None:
        pytest.skip("needs octave")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(["octave", "--no-gui", "--quiet", str(TOP / "docs/examples/matlab/swing.m")], cwd=tmp_path,
                          env=os.environ | {"PATH": path}, capture_output=True, text=True, check=True)  # fmt: skip
    numbers = re.search(r"off by (\S+) rad, at 1e-10 by (\S+); twolink by at most (\S+)", done.stdout)
    assert numbers, done.stdout
    loose, tight, bar = map(float, numbers.groups())
    assert loose > 1e-3
    assert tight < 1e-9
    assert bar < 1e-9
    assert "released from horizontal rest: right" in done.stdout
    told = [float(x) for x in done.stdout.partition("gravity =")[2].split()]
    assert told == pytest.approx(tl.load_robot("two_link").gravity_torque([np.pi / 6, 0.0]), abs=1e-3)


def test_one_function_writes_every_format(tmp_path: Path) -> None:
    robot, scene = tl.load_robot("arm"), tl.load_scene("arm-swing")
    assert tl.compare_models(robot, tl.export(robot, tmp_path / "it.urdf")).equal
    found = tl.compare_models(robot, tl.export(robot, tmp_path / "it.xml"))
    assert all("velocity limit" in line for line in str(found).splitlines()[1:])  # which an MJCF has not
    source = tl.export(robot, tmp_path / "it.c", functions=["mass_matrix"])
    assert "it_mass_matrix" in source.with_suffix(".h").read_text()
    assert tl.export(scene, tmp_path / "it.fmu", platforms=[]).exists()
    run = tl.simulate(scene, 0.1)
    assert tl.export(run, tmp_path / "it.csv").read_text() == run.save(tmp_path / "other.csv").read_text()


def support(solid: Solid, n: np.ndarray) -> float:
    """How far a ball, cylinder or capsule reaches along a direction of length 1, m."""
    shape, turned = solid.shape, pin.rpy.rpyToMatrix(np.array(getattr(solid.shape, "rpy", (0.0, 0.0, 0.0))))
    along = abs(n @ turned[:, 2])
    across = np.sqrt(1.0 - min(along, 1.0) ** 2) if isinstance(shape, fx.Cylinder) else 1.0
    return float(n @ np.array(shape.point) + 0.5 * getattr(shape, "length", 0.0) * along + shape.radius * across)


def test_a_capsule_is_shapes_that_a_urdf_has(tmp_path: Path) -> None:
    """urdfdom, by which Pinocchio reads shapes, refuses a capsule; the cylinder and balls reach as far in all ways."""
    shape = '<geometry><capsule radius="0.1" length="0.5"/></geometry>'
    turned = f'<collision name="rod"><origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 -0.6"/>{shape}</collision>'
    robot = tl.load_robot(arm_urdf(1, 2, 3, 4).replace("</link>", f"{turned}</link>", 3))
    path = robot.export_urdf(tmp_path / "r.urdf")
    again, geometry = tl.load_robot(path), pin.buildGeomFromUrdf(robot.model, str(path), pin.GeometryType.COLLISION)
    assert geometry.ngeoms == len(again.solids) == 3 * len(robot.solids) > 0
    directions = np.random.default_rng(7).normal(size=(100, 3))
    for capsule in robot.solids:
        parts = [one for one in again.solids if one.link == capsule.link]
        for n in directions / np.linalg.norm(directions, axis=1, keepdims=True):
            assert max(support(one, n) for one in parts) == pytest.approx(support(capsule, n), abs=1e-12)


NOT_WRITTEN = (("robot", "x.fmu", r"'\.fmu' is not a format"), ("scene", "x.urdf", "known: .fmu"),
               ("text", "x.c", "expected a robot, a scene or a run, got str"))  # fmt: skip


@pytest.mark.parametrize(("thing", "name", "said"), NOT_WRITTEN)
def test_what_is_not_written_is_refused(thing: str, name: str, said: str, tmp_path: Path) -> None:
    given = {"robot": tl.load_robot("arm"), "scene": tl.load_scene("arm-swing"), "text": "arm"}[thing]
    with pytest.raises(QueryError, match=said):
        tl.export(given, tmp_path / name)


@pytest.mark.parametrize("change", [
    lambda model: model.inertias.__setitem__(2, pin.Inertia(2.0, model.inertias[2].lever, model.inertias[2].inertia)),
    lambda model: setattr(model, "armature", np.array([0.0, 5.0])),
    lambda model: setattr(model, "damping", np.array([0.0, 5.0])),
    lambda model: model.jointPlacements.__setitem__(2, pin.SE3(np.eye(3), np.array([0.9, 0.0, 0.0]))),
])  # fmt: skip
@pytest.mark.parametrize("source", ["two_link", arm_urdf(1, 2, 3, 4)])
def test_changed_constants_are_not_saved_as_the_old_ones(tmp_path: Path, source: str, change: Callable) -> None:
    """The URDF beside the scene has them: the saved scene moves as the one in memory."""
    robot, motion = tl.load_robot(source).changed(change), {"q": [1.2, 0.5], "duration": 0.3}
    effects = [fx.Gravity(), *[fx.JointDamping()] * bool(robot.model.damping.any())]
    scene = tl.Scene(robot, effects=effects, **motion)
    saved = tl.load_scene(scene.save(tmp_path / "scene.toml"))
    np.testing.assert_allclose(tl.simulate(saved).q[-1], tl.simulate(scene).q[-1], rtol=1e-6)


def test_what_a_urdf_has_not_is_not_lost(tmp_path: Path) -> None:
    """Rotors' own inertia is no number of a URDF."""
    robot = tl.load_robot("two_link").changed(lambda model: setattr(model, "rotorInertia", np.array([0.0, 5.0])))
    with pytest.raises(SceneError, match="constants were changed") as caught:
        tl.Scene(robot).save(tmp_path / "scene.toml")
    assert caught.value.code == "robot-differs"
    assert not list(tmp_path.iterdir())


def test_damping_of_a_floating_joint_is_written(tmp_path: Path) -> None:
    """A thrown body of 2 kg, without gravity: v = v0 exp(-d t / m)."""
    robot = tl.load_robot("""<robot name="thrown"><link name="a"/><link name="b"><inertial><mass value="2"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="f" type="floating">
        <parent link="a"/><child link="b"/><dynamics damping="0.4"/></joint></robot>""")
    again = tl.load_robot(robot.export_urdf(tmp_path / "thrown.urdf"), gravity=(0, 0, 0))
    assert tl.compare_models(robot.with_gravity((0, 0, 0)), again).equal
    run = tl.simulate(tl.Scene(again, v=[3, 0, 0, 0, 0, 0], effects=[fx.JointDamping()]), 1.0)
    assert run.v[-1, 0] == pytest.approx(3 * np.exp(-0.4 / 2), rel=1e-7)
