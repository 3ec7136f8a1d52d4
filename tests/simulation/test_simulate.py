"""simulate: reference values, exact cases, energy, error bars that hold, samples, refusals."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import twolink as tl
from tests.near import assert_near
from twolink.errors import AccuracyError, QueryError, SceneError
from twolink.integrate.steps.methods import METHODS
from twolink.lagrange.check import arm_urdf

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -1"/>
<mass value="1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="{kind}"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""
GRAVITY = [tl.effects.Gravity()]


def pendulum_angle(t: np.ndarray, start: float) -> np.ndarray:
    """theta = 2 asin(k sn(K - w0 t, k)), from rest at `start`; w0 = sqrt(g / l), l = 1 m."""
    k = np.sin(start / 2)
    sn, *_ = ellipj(ellipk(k**2) - np.sqrt(9.81) * t, k**2)
    return 2 * np.arcsin(k * sn)


def test_the_papers_release_at_ten_seconds() -> None:
    """Reference computed in extended precision by an independent program."""
    run = tl.simulate(tl.load_scene("arm-swing"), duration=10, accuracy=1e-9)
    assert run.t[-1] == 10
    assert_near(run.q[-1], [-0.2229716591521448578, 0.74849218369550184904], 1e-9)
    assert_near(run.v[-1], [-1.7501856681930279048, 1.9141077912878002342], 1e-8)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-7, 1e-10])
def test_pendulum_is_within_its_error_bar_of_the_exact_one(kind: str, accuracy: float) -> None:
    """IFToMM's simple pendulum from the horizontal: Jacobi's elliptic functions are the truth at every sample."""
    robot = tl.load_robot(PENDULUM.format(kind=kind))
    start = np.pi / 2
    q = [start] if kind == "revolute" else [np.cos(start), np.sin(start)]
    run = tl.simulate(tl.Scene(robot, q, effects=GRAVITY), duration=10, accuracy=accuracy)
    angle = run.q[:, 0] if kind == "revolute" else np.unwrap(np.arctan2(run.q[:, 1], run.q[:, 0]))
    error = np.abs(angle - pendulum_angle(run.t, start))
    assert error.max() <= accuracy
    assert np.all(error <= run.error + 1e-13)
    if kind == "continuous":
        assert_near(np.linalg.norm(run.q, axis=1), 1, 1e-15)


def test_double_pendulum_of_rods() -> None:
    """Equal rods, both at 90 degrees, chaotic: th1, th2 absolute from downward, at t = 1, 2, 5."""
    robot = tl.load_robot(arm_urdf(1, 1, 1, 1))
    run = tl.simulate(tl.Scene(robot, effects=GRAVITY), duration=5, accuracy=1e-8)
    truth = {1: (-1.207716238190638, -0.81439102309129635), 2: (-0.082758306820570847, 0.40736207491190723),
             5: (1.1385437966718797, 1.2443799277502558)}  # fmt: skip
    for t, expected in truth.items():
        theta = run.q[np.searchsorted(run.t, t)]
        absolute = np.array([theta[0] + np.pi / 2, theta[0] + theta[1] + np.pi / 2])
        assert_near(absolute, expected, 1e-8)


def test_a_thrown_body_flies_a_parabola_and_a_bare_scene_flies_straight() -> None:
    robot = tl.load_robot("spinning_box", root="free")
    v = [3.0, 0, 4.0, 0.2, 0.1, 0.3]
    fallen = tl.simulate(tl.Scene(robot, v=v, effects=GRAVITY), duration=1.5, accuracy=1e-10)
    straight = tl.simulate(tl.Scene(robot, v=v), duration=1.5, accuracy=1e-10)
    t = fallen.t[:, None]
    assert_near(fallen.q[:, :3], t * [3, 0, 4] + t**2 / 2 * [0, 0, -9.81], 1e-9)
    assert_near(straight.q[:, :3], t * [3, 0, 4], 1e-9)


def test_energy_is_kept_and_counts_potential_only_where_there_is_gravity() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), accuracy=1e-10)
    assert np.ptp(run.energy) < 1e-8
    free = tl.simulate(tl.Scene(tl.load_robot("two_link"), v=[1.0, 0.0]), duration=2, accuracy=1e-10)
    np.testing.assert_allclose(free.energy, free.robot.energy(free.q, free.v)[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("duration", "samples", "n"), [(1.0, 200, 201), (0.0125, 200, 4), (0.3, 10, 4), (1e-12, 200, 2)]
)
def test_samples(duration: float, samples: float, n: int) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), duration, samples_per_second=samples)
    assert len(run.t) == len(run.q) == len(run.v) == len(run.energy) == n
    assert run.t[0] == 0
    assert run.t[-1] == duration
    assert np.all(np.diff(run.t) > 0)


@pytest.mark.parametrize("setting", [{"method": "rk4", "step": 0.0625}, {"method": "rk45", "tolerance": 2**-20}])
def test_numbers_of_numpy_are_numbers(setting: dict) -> None:
    scene = tl.load_scene("arm-swing")
    single = {name: x if isinstance(x, str) else np.float32(x) for name, x in setting.items()}
    run = tl.simulate(scene, np.int64(1), accuracy=np.float32(0.5), samples_per_second=np.int64(8), **single)
    assert np.array_equal(run.q, tl.simulate(scene, 1.0, accuracy=0.5, samples_per_second=8, **setting).q)


def test_not_verified_is_none_and_cheaper() -> None:
    scene = tl.load_scene("arm-swing")
    run = tl.simulate(scene, 1.0, verify=False)
    assert run.error is None
    assert run.cost.verify_seconds == 0
    assert "not verified" in repr(run)


@pytest.mark.parametrize("method", [m.name for m in METHODS.values() if m.order > 2])
def test_every_method_keeps_the_accuracy(method: str) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 2.0, accuracy=1e-5, method=method)
    reference = tl.simulate(tl.load_scene("arm-swing"), 2.0, accuracy=1e-10)
    assert_near(run.q, reference.q, 1e-5)
    assert run.cost.method == method
    assert run.cost.evaluations > run.cost.steps > 0


def test_what_cannot_be_kept_is_refused_with_the_time_it_is_kept_to() -> None:
    """Equal rods are chaotic from there: errors grow about 1.2-fold a second in the exponent."""
    scene = tl.Scene(tl.load_robot(arm_urdf(1, 1, 1, 1)), effects=GRAVITY)
    with pytest.raises(AccuracyError, match="cannot be kept in double precision") as caught:
        tl.simulate(scene, 30.0, accuracy=1e-9, samples_per_second=20, precision="double")
    until = float(caught.value.where.split()[2])
    assert 3 < until < 30
    assert f"duration={until:.6g}" in caught.value.remedy
    assert tl.simulate(scene, until, accuracy=1e-9, samples_per_second=20).t[-1] == until


def test_rest_at_an_unstable_equilibrium_is_refused() -> None:
    """The exact answer is to stay at rest upright; rounding alone moves the arm away within some 8 s."""
    scene = tl.Scene(tl.load_robot("two_link"), q=[np.pi / 2, 0.0], effects=GRAVITY)
    with pytest.raises(AccuracyError, match="cannot be kept in double precision"):
        tl.simulate(scene, 20.0, accuracy=1e-3, samples_per_second=1, precision="double")
    worlds = tl.simulate_many(scene, duration=20.0, accuracy=0.1)
    assert not worlds.within_accuracy.any()


@pytest.mark.parametrize(
    ("options", "kind", "part"),
    [
        ({"duration": 0}, SceneError, "above 0 s, got 0"),
        ({"duration": -1.0}, SceneError, "got -1.0"),
        ({"duration": float("nan")}, SceneError, "got nan"),
        ({"duration": "ten"}, SceneError, "got 'ten'"),
        ({"duration": 1e12}, SceneError, "samples, the limit"),
        ({"accuracy": 0}, AccuracyError, "above 0, got 0"),
        ({"accuracy": float("inf")}, AccuracyError, "got inf"),
        ({"accuracy": "high"}, AccuracyError, "got 'high'"),
        ({"accuracy": 10**400}, AccuracyError, "accuracy: expected a number above 0"),
        ({"samples_per_second": 0}, SceneError, "samples_per_second"),
        ({"accuracy": 1e-17, "precision": "double"}, AccuracyError, "cannot be kept in double precision"),
        ({"accuracy": 1e-20, "precision": "double"}, AccuracyError, "cannot be kept in double precision"),
        ({"samples_per_second": "many"}, SceneError, "samples_per_second"),
        ({"samples_per_second": 10**400}, SceneError, "samples_per_second: expected a number above 0"),
        ({"tolerance": "low"}, AccuracyError, "tolerance: expected a number above 0, got 'low'"),
        ({"method": "rk4", "step": float("nan")}, AccuracyError, "step: expected a number above 0, got nan"),
        ({"duration": 1.0, "method": "rk4", "step": 1e-12}, AccuracyError, "the limit is"),
        ({"duration": 1.0, "method": "rk4", "step": 20.0}, AccuracyError, "steps of 20 s are longer than 1 s"),
        ({"method": "dop853", "tolerance": 1e12}, AccuracyError, "tolerance: expected a number up to 0.1"),
        ({"method": []}, SceneError, "is unknown"),
        ({"method": "dop835"}, SceneError, "did you mean 'dop853'"),
    ],
)
def test_refusals(options: dict, kind: type, part: str) -> None:
    with pytest.raises(kind, match=part):
        tl.simulate(tl.load_scene("arm-swing"), **options)


@pytest.mark.parametrize(
    ("arguments", "kind", "part"),
    [
        ({"q": [0.0]}, QueryError, "q: expected shape"),
        ({"v": [np.nan, 0]}, QueryError, "v: expected finite"),
        ({"q": [[0.0, 0.0]]}, SceneError, "one state"),
        ({"effects": ["gravity"]}, SceneError, "expected effects, got str"),
        ({"effects": GRAVITY[0]}, SceneError, "expected a list of effects"),
        ({"effects": None}, SceneError, "expected a list of effects"),
        ({"effects": GRAVITY * 2}, SceneError, "gravity is given twice"),
        ({"duration": -2}, SceneError, "above 0 s"),
    ],
)
def test_scenes_that_are_none(arguments: dict, kind: type, part: str) -> None:
    with pytest.raises(kind, match=part):
        tl.Scene(tl.load_robot("two_link"), **arguments)


def test_a_scene_does_not_change_its_robot() -> None:
    robot = tl.load_robot("two_link")
    scene = tl.Scene(robot)
    assert np.array_equal(robot.gravity, [0, 0, -9.81])
    assert np.array_equal(scene.robot.gravity, [0, 0, 0])
    with pytest.raises(ValueError, match="read-only"):
        scene.q[0] = 1


OVERFLOWS = {
    "a field of 1e200 m/s^2": ({"effects": [tl.effects.Gravity((0.0, 0.0, -1e200))]}, {}, "t = "),
    "a series that ends at once": ({"effects": [tl.effects.Torque({"elbow": 1e300})]}, {"method": "taylor"},
                                   r"^t = 0 s: the state is not finite"),
    "speeds": ({"v": [1e200, -1e200]}, {}, "not finite"),
}  # fmt: skip


@pytest.mark.parametrize("case", OVERFLOWS)
def test_motions_that_overflow_end_in_an_error_with_the_time(case: str) -> None:
    """Not in a number, nor in a loop."""
    given, options, part = OVERFLOWS[case]
    with pytest.raises(AccuracyError, match=part), np.errstate(all="ignore"):
        tl.simulate(tl.Scene(tl.load_robot("two_link"), **given), 1.0, **options)


def test_interrupt_keeps_what_is_done() -> None:
    def stop(t: float, *_: object) -> None:
        if t > 1.0:
            raise KeyboardInterrupt

    run = tl.simulate(tl.load_scene("arm-swing"), 60.0, progress=stop)
    assert run.interrupted
    assert 0.9 < run.t[-1] < 60.0
    assert run.error is None
    assert len(run.q) == len(run.t)


def test_runs_in_threads_do_not_mix() -> None:
    scene = tl.load_scene("arm-swing")
    alone = tl.simulate(scene, 1.0, verify=False)
    with ThreadPoolExecutor(6) as pool:
        for run in pool.map(lambda _: tl.simulate(scene, 1.0, verify=False), range(6)):
            assert np.array_equal(run.q, alone.q)


def test_chaos_is_refused_whatever_is_asked() -> None:
    """In doubles nothing may be promised for 40 s of this motion, whose errors grow 1e15-fold."""
    scene = tl.Scene(tl.load_robot("two_link"), q=[1.5, 0.3], effects=GRAVITY)
    for accuracy in (1e-6, 1e-11, 1e-12, 1e-13, 1e-14):
        with pytest.raises(AccuracyError):
            tl.simulate(scene, 40.0, accuracy=accuracy, samples_per_second=10, precision="double")


def test_interrupting_the_second_solution_says_so() -> None:
    seen: list[float] = []

    def stop(t: float, *_: object) -> None:
        if seen and t <= seen[-1]:
            raise KeyboardInterrupt
        seen.append(t)

    run = tl.simulate(tl.load_scene("bouncing-ball"), 1.0, progress=stop)
    assert run.interrupted
    assert run.error is None
    assert run.t[-1] == 1.0


def test_wrong_types_are_named() -> None:
    with pytest.raises(SceneError, match="expected a Scene, got str"):
        tl.simulate("arm-swing")
    for field in ("abc", 5, (0.0, 0.0)):
        with pytest.raises(SceneError, match="3 finite numbers"):
            tl.effects.Gravity(field)
