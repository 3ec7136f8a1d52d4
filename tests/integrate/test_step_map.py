"""Step maps: compiled is portable, worlds do not feel each other, steps land where they should."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import free_bodies
from tests.integrate.problems import BOX, GRAVITY, arm, attempted, box, one_joint, random_states, rods
from twolink.errors import CertificationError
from twolink.integrate.hybrid.modes import Mode, ModeState, System
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS, Method
from twolink.integrate.steps.programs import certify_rate
from twolink.integrate.steps.step_control import control_rows, initial_state
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.lagrange.check import arm_urdf
from twolink.scenes import Scene

OURS = [m for m in METHODS.values() if m.kind in ("semi-implicit", "explicit", "implicit")]
EVERY = pytest.mark.parametrize("method", OURS, ids=lambda m: m.name)
ROBOTS: dict[str, Callable[[], tl.Robot]] = {
    "arm": lambda: tl.load_robot("two_link"),
    "continuous": lambda: one_joint("continuous"),
    "prismatic": lambda: one_joint("prismatic"),
    "planar": lambda: one_joint("planar", "0 0 1"),
    "free": lambda: tl.load_robot(BOX, root="free"),
}


def advance(steps: StepMap, x: np.ndarray, h: float, end: float, tolerance: float) -> np.ndarray:
    """The state array after one attempt from t = 0."""
    return attempted(steps, initial_state(x, 0.0, h, end, tolerance))


@pytest.mark.slow
@EVERY
@pytest.mark.parametrize("robot", ROBOTS)
def test_compiled_is_portable(robot: str, method: Method) -> None:
    """On states in no relation to those that the map was certified on; the step's control included."""
    scene = Scene(ROBOTS[robot](), effects=GRAVITY)
    equations = equations_of(scene)
    x = random_states(scene.robot, 16, seed=5)
    compiled, portable = step_map(equations, method), step_map(equations, method, portable=True)
    assert compiled.compiled
    assert not portable.compiled
    ours, theirs = (advance(m, x, 0.02, 1.0, np.inf) for m in (compiled, portable))
    np.testing.assert_allclose(ours[: len(x)], theirs[: len(x)], rtol=0, atol=1e-12 * max(1, np.abs(x).max()))
    np.testing.assert_array_equal(ours[control_rows(len(x)).time], theirs[control_rows(len(x)).time])
    if method.adaptive:
        ours, theirs = (advance(m, x, 0.2, 1.0, 1e-4)[len(x) :] for m in (compiled, portable))
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("name", ["rk4", "implicit-midpoint"])
def test_compiled_is_portable_on_six_joints(name: str) -> None:
    robot = tl.load_robot("ur5")
    equations = equations_of(Scene(robot, effects=GRAVITY))
    x = random_states(robot, 8, seed=5)
    ours, theirs = (
        advance(step_map(equations, METHODS[name], portable=p), x, 0.002, 1.0, np.inf) for p in (False, True)
    )
    np.testing.assert_allclose(ours[: len(x)], theirs[: len(x)], rtol=0, atol=1e-12 * np.abs(theirs[: len(x)]).max())


@pytest.mark.some(1)
@EVERY
@pytest.mark.parametrize("name", ["free", "crankshaft"])
def test_steps_without_the_native_library_are_the_same(
    name: str, method: Method, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With quaternions and with a loop; the control of the step included."""
    scene = Scene(ROBOTS[name](), effects=GRAVITY) if name in ROBOTS else tl.load_scene(name)
    equations = equations_of(scene)
    native = step_map(equations, method)
    assert native.compiled
    x = np.repeat(equations.start[:, None], 8, axis=1)
    if scene.robot.nv == 6:
        x = random_states(scene.robot, 8, seed=5)
    ours = advance(native, x, 0.01, 1.0, 1e-4)
    for module in ("native.machine", "integrate.steps.step_map"):
        monkeypatch.setattr(f"twolink.{module}.library", lambda: None)
    monkeypatch.setattr("twolink.native.programs._kept", {})
    by_numpy = step_map(equations, method)
    assert not by_numpy.compiled
    theirs = advance(by_numpy, x, 0.01, 1.0, 1e-4)
    np.testing.assert_allclose(ours[: len(x)], theirs[: len(x)], rtol=0, atol=1e-12 * max(1, np.abs(x).max()))
    np.testing.assert_allclose(ours[len(x) :], theirs[len(x) :], rtol=1e-6)


def test_a_rate_that_is_wrong_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    wrong = lambda *given: 1.0000001 * traced_rate(*given)  # noqa: E731
    monkeypatch.setattr("twolink.integrate.steps.programs.traced_rate", wrong)
    robot = tl.load_robot(arm_urdf(1, 1, 1, 1.2345))
    with pytest.raises(CertificationError, match="the rate differs from Pinocchio's"):
        step_map(equations_of(Scene(robot, effects=GRAVITY)), METHODS["rk4"])


def test_at_an_edge_the_rate_of_either_side_is_right() -> None:
    """A ball rolls over a box's edge, beyond which it turns about it. Where it begins, rounding chooses the side."""
    e = tl.effects
    shapes = {"ball": (e.Sphere(0.1),), "box": (e.Box((1.0, 1.0, 1.0)),)}
    contact = e.Contact((("ball", "box"),), shapes=shapes)
    q, v = [0.5, 0.0, 0.6, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1], [0.3, *[0.0] * 11]
    whole = equations_of(Scene(free_bodies("ball", "box"), q, v, [e.Gravity(), contact]))
    touching = ModeState(System(whole), Mode(("sliding",), ((0.0, 0.0),)), whole.start[: whole.moving], 0.0)
    equations = replace(touching.own.equations, start=touching.full_state())
    beyond = np.zeros((equations.space.size, 1))
    beyond[0] = 1e-11

    def by_pinocchio(on_the_other_side: float, factor: float = 1.0) -> Callable[[np.ndarray], np.ndarray]:
        def compiled(rows: np.ndarray) -> np.ndarray:
            x = rows[1 : 1 + equations.space.size].copy()
            x[:, :1] += on_the_other_side * beyond
            return factor * rate(equations, 0.0, x)

        return compiled

    before, after = (by_pinocchio(side)(np.vstack([[0.0], equations.start[:, None]])) for side in (-1.0, 1.0))
    assert np.abs(after - before).max() > 0.1
    certify_rate(equations, by_pinocchio(-1.0))
    certify_rate(equations, by_pinocchio(1.0))
    with pytest.raises(CertificationError, match="the rate differs from Pinocchio's"):
        certify_rate(equations, by_pinocchio(-1.0, 1.001))


def test_a_parameter_of_a_world_is_a_robot_built_with_it() -> None:
    """Four masses of the forearm in one call, and four robots of their own."""
    masses = np.array([0.5, 1.0, 2.0, 3.5])
    base = equations_of(rods(), parameters=["forearm.mass", "forearm.inertia.yy", "gravity.z"])
    x = random_states(base.robot, 4)
    values = np.array([masses, masses / 12, np.full(4, -9.81)])
    steps = step_map(base, METHODS["rk4"])
    together = steps.partial(x, np.zeros(4), np.full(4, 0.05), values)
    for i, mass in enumerate(masses):
        own = equations_of(Scene(tl.load_robot(arm_urdf(1, 1, 1, float(mass))), effects=GRAVITY))
        alone = step_map(own, METHODS["rk4"]).partial(x[:, i : i + 1], np.zeros(1), np.full(1, 0.05))
        np.testing.assert_allclose(together[:, i], alone[:, 0], rtol=0, atol=1e-13)
    assert np.abs(steps.partial(x, np.zeros(4), np.full(4, 0.05), values * 1.01) - together).max() > 1e-6


@EVERY
def test_steps_land_on_the_end(method: Method) -> None:
    """From 0 to 0.7 in steps of 0.1, which is not a binary fraction: neither a crumb is left nor the end missed."""
    steps = step_map(equations_of(arm()), method)
    state = initial_state(steps.equations.start[:, None], 0.0, 0.1 * 0.2, 0.7 * 0.2, 1e9)
    clock = control_rows(4).time
    for _ in range(20):
        if state[clock, 0] == 0.7 * 0.2:
            break
        state = attempted(steps, state)
    assert state[clock, 0] == 0.7 * 0.2
    if not method.adaptive:
        assert state[control_rows(4).accepted, 0] == 7
    np.testing.assert_array_equal(attempted(steps, state), state)  # who has arrived stays


@EVERY
def test_quaternions_stay_unit(method: Method) -> None:
    steps = step_map(equations_of(box()), method)
    x = random_states(steps.equations.robot, 64)
    for i in range(20):
        x = steps.partial(x, np.full(64, 0.02 * i), np.full(64, 0.02 * (i + 1)))
    np.testing.assert_allclose(np.linalg.norm(x[3:7], axis=0), 1, rtol=0, atol=1e-15)


@pytest.mark.parametrize("method", [m for m in OURS if m.adaptive], ids=lambda m: m.name)
@pytest.mark.parametrize("portable", [False, True])
def test_a_refused_step_leaves_the_state(method: Method, portable: bool) -> None:
    scene = arm()
    steps = step_map(equations_of(scene), method, portable=portable)
    x = random_states(scene.robot, 8)
    h = 0.5
    out = advance(steps, x, h, 10.0, 1e-13)
    np.testing.assert_array_equal(out[:4], x)
    now = out[4:]
    assert not now[control_rows(0).time].any()
    assert not now[control_rows(0).accepted].any()
    assert np.all(now[control_rows(0).rejected] == 1)
    assert np.all((now[control_rows(0).step] >= 0.19 * h) & (now[control_rows(0).step] < h))


@EVERY
@pytest.mark.parametrize("portable", [False, True])
def test_nan_is_never_a_step(method: Method, portable: bool) -> None:
    """A world whose rate overflows: adaptive methods stay where they are and shrink, fixed ones say NaN; the world
    beside it does not notice."""
    scene = arm()
    steps = step_map(equations_of(scene), method, portable=portable)
    x = np.repeat(steps.equations.start[:, None], 8, axis=1)
    alone = advance(steps, x, 0.01, 1.0, 1e-3)
    x[2:, 1] = 1e200
    out = advance(steps, x, 0.01, 1.0, 1e-3)
    np.testing.assert_array_equal(out[:, [0, 2, 7]], alone[:, [0, 2, 7]])
    if method.adaptive:
        np.testing.assert_array_equal(out[:4, 1], x[:, 1])
        assert out[control_rows(4).rejected, 1] == 1
        assert out[control_rows(4).step, 1] == out[control_rows(4).good, 1] == pytest.approx(0.9 * 0.01)
    else:
        assert not np.isfinite(out[:4, 1]).all()
