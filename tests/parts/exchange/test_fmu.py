"""Scenes as FMUs: validated and simulated by FMPy, which shares no code with us, and called function by function."""

import shutil
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import ClassVar

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree
from scipy.integrate import solve_ivp

import twolink as tl
from twolink import effects as fx
from twolink.algorithms.motion import KinematicState
from twolink.effects.effect import Loads
from twolink.errors import SceneError, TwolinkError
from twolink.scenes.parameters import scene_with

T = 1.0
BODY = """<inertial><origin xyz="0.1 0 0.05"/><mass value="2"/><inertia ixx="0.03" iyy="0.05" izz="0.06" ixy="0.002"
ixz="0" iyz="0.001"/></inertial>"""
SATELLITE = f"""<robot name="a &lt;free&gt; &quot;body&quot; */"><link name="body">{BODY}</link>
<link name="wheel">{BODY}</link><joint name="spin &amp; &quot;é&quot;" type="continuous"><parent link="body"/>
<child link="wheel"/></joint></robot>"""


def double_pendulum() -> tl.Scene:
    robot = tl.load_robot("double_pendulum_continuous")
    damping = fx.JointDamping(damping={joint.name: 0.05 for joint in robot.joints})
    return tl.Scene(robot, q={joint.name: 1.0 for joint in robot.joints}, effects=[fx.Gravity(), damping])


def panda() -> tl.Scene:
    robot = tl.load_robot("panda")
    return tl.Scene(robot, q=robot.random_state(1, seed=3)[0][0], effects=[fx.Gravity()])


def free_body() -> tl.Scene:
    robot = tl.load_robot(SATELLITE, root="free")
    q, v = robot.random_state(1, seed=2)
    return tl.Scene(robot, q[0], v[0], effects=[fx.Gravity()])


def with_friction() -> tl.Scene:
    arm = tl.load_scene("arm-swing")
    return arm.with_effects([*arm.effects, fx.SmoothFriction({arm.robot.joints[0].name: 0.3})])


SCENES: dict[str, Callable[[], tl.Scene]] = {
    "arm": lambda: tl.load_scene("arm-swing"),
    "double_pendulum": double_pendulum,
    "panda": panda,
    "free_body": free_body,
    "elastic": lambda: tl.load_scene("elastic-joint"),
    "tables": lambda: tl.load_scene("muscles"),
    "friction": with_friction,
    "top": lambda: tl.load_scene("spinning-top"),
    "crankshaft": lambda: tl.load_scene("crankshaft"),
}
FEW = {"panda": ["gravity.z", "panda_link1.mass"]}  # parameters


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    yield tmp_path_factory.mktemp("fmus")
    exported.cache_clear()


@cache
def exported(name: str, folder: Path) -> Path:
    path = SCENES[name]().export_fmu(folder / f"{name}.fmu", FEW.get(name))
    fmpy.extract(str(path), str(folder / name))
    return path


class Fmu:
    """An instance with its variables by name."""

    def __init__(self, name: str, folder: Path, *, model_exchange: bool = False, tolerance: float | None = None):
        exported(name, folder)
        self.described = fmpy.read_model_description(str(folder / name))
        self.numbers = {v.name: v.valueReference for v in self.described.modelVariables}
        kind = FMU3Model if model_exchange else FMU3Slave
        identifier = self.described.coSimulation.modelIdentifier
        self.fmu = kind(guid=self.described.guid, unzipDirectory=str(folder / name), modelIdentifier=identifier,
                        instanceName=name)  # fmt: skip
        self.fmu.instantiate()
        self.states = [v.derivative.valueReference for v in self.described.modelVariables if v.derivative]
        self.rates = [v.valueReference for v in self.described.modelVariables if v.derivative]
        self.tolerance = tolerance

    def started(self, **values: float) -> "Fmu":
        for name, value in values.items():
            self[name.replace("__", ".")] = value
        self.fmu.enterInitializationMode(tolerance=self.tolerance)
        self.fmu.exitInitializationMode()
        return self

    def __getitem__(self, name: str) -> float:
        return self.fmu.getFloat64([self.numbers[name]])[0]

    def __setitem__(self, name: str, value: float) -> None:
        self.fmu.setFloat64([self.numbers[name]], [value])

    @property
    def x(self) -> np.ndarray:
        return np.array(self.fmu.getFloat64(self.states))

    def f(self, t: float, x: np.ndarray) -> np.ndarray:
        self.fmu.setTime(t)
        self.fmu.setContinuousStates((fmpy.fmi3.fmi3Float64 * len(x))(*x), len(x))
        return np.array(self.fmu.getFloat64(self.rates))

    def step(self, t: float, h: float) -> None:
        self.fmu.doStep(t, h)


def states_of(run: tl.Trajectory) -> np.ndarray:
    return np.concatenate([run.q, run.v, *(z[:, None] for z in run.states.values())], axis=1)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", SCENES)
def test_fmpy_has_no_complaint(name: str, folder: Path) -> None:
    path = exported(name, folder)
    assert validate_fmu(str(path)) == []
    schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema/fmi3/fmi3BuildDescription.xsd"))
    schema.assertValid(etree.parse(str(folder / name / "sources/buildDescription.xml")))
    described = fmpy.read_model_description(str(path))
    assert (described.modelExchange is None) == (name == "crankshaft")
    assert {v.unit for v in described.modelVariables} <= {u.name for u in described.unitDefinitions} | {None}


@pytest.mark.some(2)
@pytest.mark.parametrize("name", SCENES)
def test_co_simulation_agrees_within_its_tolerance(name: str, folder: Path) -> None:
    run = tl.simulate(SCENES[name](), T, accuracy=1e-8, t_eval=np.linspace(0, T, 11))
    fmu, tolerance = Fmu(name, folder, tolerance=1e-7).started(), 1e-7
    expected, scale = states_of(run), 1.0 + np.abs(run.v).max()
    for k, t in enumerate(run.t[:-1]):
        fmu.step(float(t), float(run.t[k + 1] - t))
        assert np.abs(fmu.x - expected[k + 1])[: run.q.shape[1]].max() <= tolerance + run.error[k + 1]
        assert np.abs(fmu.x - expected[k + 1]).max() <= 100 * tolerance * scale
    assert fmu["energy"] == pytest.approx(run.energy[-1], abs=1e-5 * scale)


EXPORTED = ("arm-human", "arm-swing", "bricard", "crank-spring", "crankshaft", "elastic-joint", "four-bar", "heavy-top",
            "meal-assist", "meal-smooth", "muscles", "panda-hold", "spinning-top", "squeezer", "stick-slip",
            "tippe-top")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", [scene["name"] for scene in tl.scenes()])
def test_co_simulation_agrees_over_the_duration_of_every_bundled_scene(name: str, folder: Path) -> None:
    SCENES[name] = lambda: tl.load_scene(name)
    if name not in EXPORTED:
        with pytest.raises(SceneError, match=r"cannot be in an FMU|its limit makes events"):
            exported(name, folder)
        return
    scene, tolerance = SCENES[name](), 1e-7
    times = np.linspace(0, scene.duration, 21)
    run = tl.simulate(scene, scene.duration, accuracy=1e-7 if name == "four-bar" else 1e-9, t_eval=times)
    fmu = Fmu(name, folder, tolerance=tolerance).started()
    for k, t in enumerate(times[:-1]):
        fmu.step(float(t), float(times[k + 1] - t))
        assert np.abs(fmu.x[: run.q.shape[1]] - run.q[k + 1]).max() <= tolerance + run.error[k + 1]


@pytest.mark.some(1)
@pytest.mark.parametrize("name", [name for name in SCENES if name not in ("tables", "crankshaft")])
def test_model_exchange_agrees_within_the_error_bar(name: str, folder: Path) -> None:
    run = tl.simulate(SCENES[name](), T, accuracy=1e-8, t_eval=[0, T])
    fmu = Fmu(name, folder, model_exchange=True).started()
    fmu.fmu.updateDiscreteStates()
    fmu.fmu.enterContinuousTimeMode()
    found = solve_ivp(fmu.f, (0, T), fmu.x, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert np.abs(found - states_of(run)[-1])[: run.q.shape[1]].max() <= run.error[-1] + 1e-9


@pytest.mark.some(4)
@pytest.mark.parametrize("name", ["arm", "free_body", "elastic", "top", "panda"])
def test_directional_derivatives_are_those_of_differences(name: str, folder: Path) -> None:
    fmu = Fmu(name, folder, model_exchange=True).started()
    fmu.fmu.updateDiscreteStates()
    kinds = {v.valueReference: v.causality for v in fmu.described.modelVariables}
    knowns = [*fmu.states, *(r for r, kind in kinds.items() if kind in ("input", "parameter"))]
    unknowns = [*fmu.rates, fmu.numbers["energy"]]
    at, random, h = np.array(fmu.fmu.getFloat64(knowns)), np.random.default_rng(4), 1e-4
    state = fmu.fmu.getFMUState()
    n = len(fmu.states)

    def values(x: np.ndarray) -> np.ndarray:
        fmu.fmu.setFMUState(state)
        fmu.fmu.setFloat64(knowns[n:], list(x[n:]))
        fmu.fmu.enterContinuousTimeMode()
        fmu.f(0.0, x[:n])
        return np.array(fmu.fmu.getFloat64(unknowns))

    for _ in range(5):
        seed = random.normal(size=len(knowns)) * (1e-2 + np.abs(at))
        seed[n:] *= 1e-2
        differences = (8 * (values(at + h * seed) - values(at - h * seed))
                       - (values(at + 2 * h * seed) - values(at - 2 * h * seed))) / (12 * h)  # fmt: skip
        fmu.fmu.setFMUState(state)
        found = np.array(fmu.fmu.getDirectionalDerivative(unknowns, knowns, list(seed)))
        assert np.abs(found - differences).max() <= 1e-7 * (1 + np.abs(found).max())


def test_dependencies_are_true(folder: Path) -> None:
    """What no dependency names has no derivative, at many states."""
    fmu = Fmu("elastic", folder, model_exchange=True).started()
    knowns = [*fmu.states, *(r for name, r in fmu.numbers.items() if name.startswith("tau."))]
    few = 0
    for unknown in (*fmu.described.derivatives, *fmu.described.outputs):
        named = {v.valueReference for v in unknown.dependencies}
        for known in set(knowns) - named:
            few += 1
            assert fmu.fmu.getDirectionalDerivative([unknown.variable.valueReference], [known], [1.0]) == [0.0]
    assert few > 20


def test_parameters_are_those_of_the_scene(folder: Path) -> None:
    scene, fmu = SCENES["double_pendulum"](), Fmu("double_pendulum", folder, tolerance=1e-8)
    chosen = {"gravity.z": -3.7, **{name: 1.3 * fmu[name] for name in fmu.numbers if name.endswith(".mass")},
              "effects.1.damping." + scene.robot.joints[0].name: 0.4}  # fmt: skip
    for name, value in chosen.items():
        fmu[name] = value
    fmu.started().step(0.0, T)
    run = tl.simulate(scene_with(scene, chosen), T, accuracy=1e-9, t_eval=[0, T])
    np.testing.assert_allclose(fmu.x, states_of(run)[-1], atol=1e-7)
    assert fmu["energy"] == pytest.approx(run.energy[-1], abs=1e-6)
    with pytest.raises(FMICallException):
        fmu["energy"] = 1.0


def test_a_rotor_is_the_armature_of_its_joint(tmp_path: Path) -> None:
    """A gear's ratio and inertia are in the robot when the FMU is written; what is inside the gear is a parameter."""
    gear = fx.Gear(fx.Torque({"elbow": 1.0}), ratio={"elbow": 3.0}, inertia={"elbow": 0.01})
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[fx.Gravity(), gear], duration=T)
    path = str(scene.export_fmu(tmp_path / "gear.fmu"))
    names = {v.name for v in fmpy.read_model_description(path).modelVariables}
    assert {"effects.1.ratio.elbow", "effects.1.inertia.elbow"}.isdisjoint(names)
    chosen = {"effects.1.inertia.elbow": 0.013, "effects.1.of.inputs.elbow": 1.4}
    run = tl.simulate(scene_with(scene, chosen), accuracy=1e-10)
    chosen["elbow.armature"] = 3.0**2 * chosen.pop("effects.1.inertia.elbow")
    assert abs(_end(path, chosen) - run.q[-1, 0]) < 1e-7
    with pytest.raises(SceneError, match=r"effects\.1\.ratio\.elbow.*armature"):
        scene.export_fmu(tmp_path / "gear.fmu", ["effects.1.ratio.elbow"])


class Drag(fx.Effect, frozen=True):
    """A torque -v (1 + v^2)^1.5 on the shoulder, more where q > 0.5; powers: written as one, or by a root."""

    analytic: ClassVar[bool] = False
    powers: bool = True

    def act(self, motion: KinematicState, loads: Loads) -> None:
        xp, base = motion.xp, 1.0 + motion.v[0] * motion.v[0]
        size = motion.v[0] * (xp.power(base, 1.5) if self.powers else base * xp.sqrt(base))
        after = xp.less_equal(motion.q[0], 0.5) if self.powers else 1.0 - xp.less(0.5, motion.q[0])
        loads.torque(0, xp.where(after, -size, (-0.5 - motion.q[0]) * size))


def test_own_effects_have_powers_and_all_comparisons(tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.9, 0.5], effects=[fx.Gravity(), Drag()], duration=T)
    path = str(scene.export_fmu(tmp_path / "drag.fmu", []))
    run = tl.simulate(scene.with_effects([fx.Gravity(), Drag(powers=False)]), accuracy=1e-9)
    assert run.q[:, 0].min() < 0.5 < run.q[0, 0]
    assert abs(_end(path, {}) - run.q[-1, 0]) < 1e-6


def test_states_of_effects_begin_by_the_scenes_start(tmp_path: Path) -> None:
    """The filter of a PID begins at the velocity: with another one the importer sets it, as the description says."""
    pid = fx.PID({"shoulder": 0.3}, {"shoulder": 20.0}, {"shoulder": 5.0}, {"shoulder": 2.0},
                         filter={"shoulder": 0.05})  # fmt: skip
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], [0.3, -0.2], [fx.Gravity(), pid], T)
    faster = scene_with(scene, {"v.shoulder": 2.0})
    run = tl.simulate(faster, accuracy=1e-10)
    path = str(scene.export_fmu(tmp_path / "pid.fmu", []))
    chosen = {"v.shoulder": 2.0}
    assert abs(_end(path, chosen) - run.q[-1, 0]) > 1e-3
    chosen |= {f"z.{name}": float(z[0]) for name, z in run.states.items()}
    assert abs(_end(path, chosen) - run.q[-1, 0]) < 1e-7


def _end(path: str, start: dict[str, float]) -> float:
    rows = fmpy.simulate_fmu(path, start_values=start, stop_time=T, output_interval=T, relative_tolerance=1e-9)
    return float(rows["q.shoulder"][-1])


def test_inputs_are_torques_held_within_a_step(folder: Path) -> None:
    scene, fmu = SCENES["free_body"](), Fmu("free_body", folder, tolerance=1e-9).started()
    sim, random = tl.Simulation(scene, accuracy=1e-9), np.random.default_rng(1)
    torques = [name for name in fmu.numbers if name.startswith("tau.")]
    assert len(torques) == scene.robot.nv
    for k in range(20):
        tau = random.normal(size=len(torques))
        for name, value in zip(torques, tau, strict=True):
            fmu[name] = value
        fmu.step(k * 0.01, 0.01)
        state = sim.step(0.01, tau)
    np.testing.assert_allclose(fmu.x, [*state.q, *state.v], atol=1e-8)
    assert np.linalg.norm(fmu.x[3:7]) == pytest.approx(1.0, abs=1e-14)


def test_instances_are_independent_and_states_come_back(folder: Path) -> None:
    one, other = Fmu("arm", folder).started(), Fmu("arm", folder).started(gravity__z=-1.0)
    alone = Fmu("arm", folder).started()
    for k in range(10):
        one.step(k * 0.05, 0.05)
        other.step(k * 0.05, 0.05)
    for k in range(10):
        alone.step(k * 0.05, 0.05)
    np.testing.assert_array_equal(one.x, alone.x)
    assert np.abs(one.x - other.x).max() > 0.1
    saved = one.fmu.getFMUState()
    kept = one.fmu.serializeFMUState(saved)
    one.step(0.5, 0.2)
    after = one.x
    one.fmu.setFMUState(saved)
    one.step(0.5, 0.2)
    np.testing.assert_array_equal(one.x, after)
    other.fmu.setFMUState(other.fmu.deserializeFMUState(kept))
    other.step(0.5, 0.2)
    np.testing.assert_array_equal(other.x, after)
    one.fmu.reset()
    one.started()
    for k in range(10):
        one.step(k * 0.05, 0.05)
    np.testing.assert_array_equal(one.x, alone.x)
    for fmu in (one, other, alone):
        fmu.fmu.terminate()
        fmu.fmu.freeInstance()


def test_what_is_not_allowed_is_refused(folder: Path) -> None:
    fmu = Fmu("top", folder).started()
    for call in (lambda: fmu.step(0.5, 0.1), lambda: fmu.step(0.0, -0.1), lambda: fmu.step(0.0, float("nan")),
                 lambda: fmu.fmu.getFloat64([9999]), lambda: fmu.fmu.getInt32([0]),
                 lambda: fmu.fmu.enterInitializationMode()):  # fmt: skip
        with pytest.raises(FMICallException):
            call()
    first = next(name for name in fmu.numbers if name.startswith("q."))
    with pytest.raises(FMICallException):
        fmu[first] = 0.0  # a state, on the way
    fmu.step(0.0, 0.1)  # it still goes on
    zero = Fmu("top", folder)
    for name in zero.numbers:
        if name.startswith("q."):
            zero[name] = 0.0
    with pytest.raises(FMICallException):
        zero.started()  # no quaternion


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm")
def test_sources_are_strict_c_with_official_signatures_and_no_globals(folder: Path) -> None:
    exported("elastic", folder)
    sources = folder / "elastic" / "sources"
    headers = Path(fmpy.__file__).parent / "c-code"
    warnings = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-parameter"]
    strict = ["cc", "-std=c99", "-O1", *warnings, "-fPIC", "-c"]
    official = ["-I", str(headers), "-include", "fmi3Functions.h"]
    for extra in ([], official, ["-DFMI3_FUNCTION_PREFIX=elastic_"]):
        for file in ("fmu.c", "elastic.c"):
            subprocess.run([*strict, *extra, str(sources / file), "-o", str(folder / f"{file}.o")], check=True)
    listed = subprocess.run(["nm", str(folder / "fmu.c.o"), str(folder / "elastic.c.o")], capture_output=True,
                            text=True, check=True).stdout  # fmt: skip
    kinds = {line.split()[-2]: line.split()[-1] for line in listed.splitlines() if len(line.split()) > 1}
    assert not kinds.keys() & set("bBdDC"), kinds
    needed = {line.split()[-1] for line in listed.splitlines() if " U " in line}
    outside = {name for name in needed if not name.startswith("elastic_")}
    assert outside <= {"calloc", "malloc", "free", "memcpy", "memset", "strcmp", "pow", "sin", "cos", "sqrt", "exp",
                       "tanh", "fmin", "fmax", "sincos", "_GLOBAL_OFFSET_TABLE_"}  # fmt: skip


def test_equal_scenes_give_equal_files(folder: Path) -> None:
    paths = [SCENES["arm"]().export_fmu(folder / f"{i}" / "1 arm é.fmu", platforms=[]) for i in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    names = zipfile.ZipFile(paths[0]).namelist()
    assert names[0] == "modelDescription.xml"
    assert not any("binaries" in name or name.endswith(".py") for name in names)
    assert validate_fmu(str(paths[0])) == []


@pytest.mark.slow
@pytest.mark.parametrize(("platform", "magic"), [("x86_64-windows", b"MZ"), ("aarch64-linux", b"\x7fELF"),
                                                 ("aarch64-darwin", b"\xcf\xfa\xed\xfe")])  # fmt: skip
def test_zig_compiles_for_other_platforms(platform: str, magic: bytes, folder: Path) -> None:
    pytest.importorskip("ziglang", reason="the extra `fmu` is not installed")
    path = SCENES["arm"]().export_fmu(folder / "arm.fmu", platforms=[platform])
    archive = zipfile.ZipFile(path)
    (library,) = (name for name in archive.namelist() if name.startswith(f"binaries/{platform}/"))
    assert archive.read(library).startswith(magic)


def test_what_an_fmu_cannot_hold_is_refused(tmp_path: Path) -> None:
    arm = SCENES["arm"]()
    joint, path = arm.robot.joints[0].name, tmp_path / "x.fmu"

    def with_effect(effect: fx.Effect) -> tl.Scene:
        return arm.with_effects([*arm.effects, effect])

    limited = fx.JointPD(target={joint: 0.0}, kp={joint: 1.0}, effort={joint: 1.0})
    sampled = fx.Controller(lambda _t, _y, state: (0.0, state), outputs=(joint,))
    stops = fx.JointStops({joint: (-1.0, 1.0)})
    for effect, text in ((stops, "JointStops"), (limited, "limit"), (sampled, "ticks")):
        with pytest.raises(SceneError, match=text) as caught:
            with_effect(effect).export_fmu(path)
        assert caught.value.code == "no-fmu"
        assert "scene.without(" in str(caught.value)
    for given in ({"parameters": ["forearm.masss"]}, {"parameters": [f"{joint}.damping"]}, {"parameters": ["q.x"]},
                  {"platforms": ["amiga"]}):  # fmt: skip
        with pytest.raises(TwolinkError):
            arm.export_fmu(path, **given)
    with pytest.raises(TwolinkError, match=r"known: \.fmu"):
        arm.export_fmu(tmp_path / "x.zip")
    with pytest.raises(SceneError, match="no joint moves"):
        tl.Scene(tl.load_robot("heavy_top")).export_fmu(path)
    assert list(tmp_path.iterdir()) == []


def with_table(beyond: str) -> tl.Scene:
    arm = tl.load_scene("arm-swing")
    table = fx.Sampled(times=(0.0, 0.2, 0.25, 0.6), values=(0.0, 3.0, -2.0, 1.0), interpolation="cubic", beyond=beyond)
    return arm.with_effects([*arm.effects, fx.Torque({arm.robot.joints[0].name: table})])


@pytest.mark.parametrize(("name", "scene", "end"), [
    ("curve", lambda: tl.load_scene("meal-smooth"), 3.0), ("table", lambda: with_table("error"), 0.6),
])  # fmt: skip
def test_what_ends_ends_the_fmu(name: str, scene: Callable[[], tl.Scene], end: float, folder: Path) -> None:
    SCENES[name] = scene
    run = tl.simulate(scene(), end, accuracy=1e-9, t_eval=[0, end])
    fmu = Fmu(name, folder).started()
    fmu.step(0.0, end)
    np.testing.assert_allclose(fmu.x, states_of(run)[-1], atol=1e-6)
    with pytest.raises(FMICallException):
        fmu.step(end, 0.1)
    rows = fmpy.simulate_fmu(str(folder / f"{name}.fmu"), fmi_type="ModelExchange", stop_time=2 * end)
    assert rows["time"][-1] == pytest.approx(end, abs=1e-9)


def test_a_table_has_time_events(folder: Path) -> None:
    SCENES["zero"] = lambda: with_table("zero")
    run = tl.simulate(SCENES["zero"](), T, accuracy=1e-9, t_eval=[0, T])
    fmu = Fmu("zero", folder, model_exchange=True).started()
    t, x, times = 0.0, fmu.x, []
    while t < T:
        *_, defined, following = fmu.fmu.updateDiscreteStates()
        to = min(following, T) if defined else T
        times.append(to)
        fmu.fmu.enterContinuousTimeMode()
        x = solve_ivp(fmu.f, (t, to), x, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        fmu.f(to, x)
        fmu.fmu.enterEventMode()
        t = to
    assert times == [0.2, 0.25, 0.6, T]
    np.testing.assert_allclose(x, states_of(run)[-1], atol=1e-9)
