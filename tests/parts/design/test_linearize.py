"""linearize: against closed forms, differences in long double precision, and sensitivities along a motion."""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest

import twolink as tl
from tests.simulation.test_sensitivities import FREE
from twolink.algorithms.namespaces import Numbers
from twolink.errors import CertificationError, SceneError
from twolink.integrate.motion.formulas import accelerations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.parts.design import smooth

E = tl.effects
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


def panda() -> tl.Scene:
    scene = tl.load_scene("panda-hold")
    random = np.random.default_rng(1)
    effects = [E.Gravity(), E.JointPD({"panda_joint4": -2.0}, {"panda_joint4": 30.0}, {"panda_joint4": 2.0}),
               E.AirDrag("panda_hand", 0.1), E.FrameWrench("panda_hand", (5.0, E.Sine(3.0, 2.0), 0.0))]  # fmt: skip
    return tl.Scene(scene.base, scene.q, random.uniform(-1, 1, 7), effects)


def of_state(s: tl.Sensitivities) -> np.ndarray:
    """d(q, v)/d(q, v) of the start (n, 2 nv, 2 nv)."""
    return np.concatenate([np.concatenate([part[name] for name in "qv"], 2) for part in (s.q, s.v)], 1)


def difference_of(rows: np.ndarray) -> np.ndarray:
    """The rates of rows, for a step of 1, at all but the first and last four of them."""
    n = len(rows)
    return sum(w * (rows[4 + i : n - 4 + i] - rows[4 - i : n - 4 - i]) for i, w in enumerate(WEIGHTS, 1))


def test_panda_against_differences_in_long_double_precision() -> None:
    scene = panda()
    a, b, names = tl.linearize(scene, t=0.3)
    equations = equations_of(scene)
    mech, numbers = equations.mechanism, equations.start[equations.moving :]
    step, nv = np.longdouble(1e-3), 7
    shifts = step * np.array([-4, -3, -2, -1, 1, 2, 3, 4])
    for k in range(2 * nv):
        x = np.repeat(np.concatenate([scene.q, scene.v, numbers])[:, None], 8, axis=1).astype(np.longdouble)
        x[k] += shifts
        rows = np.array(accelerations(equations, mech, np.longdouble(0.3), x, Numbers))
        column = (rows[:, 4:] - rows[:, 3::-1]) @ WEIGHTS.astype(np.longdouble) / step
        np.testing.assert_allclose(a[nv:, k], column.astype(float), rtol=0, atol=1e-13 * np.abs(a).max())
    np.testing.assert_array_equal(a[:nv], np.eye(nv, 14, 7))
    np.testing.assert_allclose(b[nv:] @ scene.robot.mass_matrix(scene.q), np.eye(nv), atol=1e-11)
    assert not b[:nv].any()
    assert names[0] == "q.panda_joint1"
    assert names[-1] == "v.panda_joint7"


def test_the_pendulum_has_its_closed_form(pendulum_urdf: str) -> None:
    """theta'' = -(g / l) sin theta - d theta' / (m l^2) + u / (m l^2), with m = 2, l = 0.5."""
    scene = tl.Scene(tl.load_robot(pendulum_urdf), effects=[E.Gravity(), E.JointDamping({"hinge": 0.3})])
    down, up = tl.linearize(scene), tl.linearize(scene, [np.pi])
    k, d = 9.81 / 0.5, 0.3 / 0.5
    np.testing.assert_allclose(down.A, [[0, 1], [-k, -d]], atol=1e-14)
    np.testing.assert_allclose(down.B, [[0], [2.0]], atol=1e-14)
    exact = np.array([-d / 2 + np.sqrt(d * d / 4 + k), -d / 2 - np.sqrt(d * d / 4 + k)])
    np.testing.assert_allclose(up.eigenvalues, exact, atol=1e-12)
    assert (np.abs(up.eigenvalues - exact) <= up.eigenvalue_errors).all()
    assert down.stability == "asymptotically stable"
    assert up.stability == "saddle"
    assert down.controllability.rank == 2
    assert "saddle" in str(up)
    assert "rank 2 of 2" in str(up)


def test_along_a_motion_it_is_the_rate_of_sensitivities() -> None:
    """S' = A(t) S for a brick that tumbles, with a quaternion and a continuous joint."""
    robot = tl.load_robot(FREE, root="free")
    q, v = robot.random_state(1, seed=4)
    scene = tl.Scene(robot, q[0], 2.0 * v[0], [E.Gravity(), E.FrameWrench("arm", (0.0, E.Sine(2.0, 3.0), 1.0))])
    s = tl.sensitivities(scene, wrt=["q", "v"], duration=0.5, accuracy=1e-10, samples_per_second=100)
    whole, middle, run = of_state(s), slice(4, -4), s.run
    rate = 100 * difference_of(whole)
    about = tl.linearize(scene, run.q[middle], run.v[middle], t=run.t[middle])
    np.testing.assert_allclose(about.A @ whole[middle], rate, atol=1e-7 * np.abs(rate).max())
    assert about.B.shape == (len(rate), 14, 1)
    one = tl.linearize(scene, run.q[10], run.v[10], t=run.t[10])
    np.testing.assert_allclose(about.state(6).A, one.A, atol=1e-12)


def test_states_without_derivatives_are_refused() -> None:
    robot, gravity = tl.load_robot("two_link"), E.Gravity()
    cases = {
        "elbow": ([0.2, 0.3], [1.0, 0.0], E.DryFriction({"elbow": 50.0})),  # held
        "'elbow'": ([0.2, 0.3], [1.0, 0.0], E.DryFriction({"elbow": 0.1})),  # begins to slip
        "stop": ([0.2, 0.8], [0.0, -1.0], E.JointStops({"elbow": (-0.3, 0.8)})),
        "limit": ([0.2, 0.5], [0.0, 0.0], E.JointPD({"elbow": 1.0}, {"elbow": 10.0}, effort={"elbow": 5.0})),
    }
    for part, (q, v, effect) in cases.items():
        with pytest.raises(SceneError) as caught:
            tl.linearize(tl.Scene(robot, q, v, [gravity, effect]))
        assert caught.value.code == "not-differentiable", part
        assert "elbow" in str(caught.value)


def test_within_a_mode_switching_effects_are_linearized() -> None:
    """A joint that slips has a constant friction torque, which does not change A; beside its stop it is free."""
    robot, gravity = tl.load_robot("two_link"), E.Gravity()
    state = [0.2, 0.3], [0.4, -1.0]
    plain = tl.linearize(tl.Scene(robot, *state, [gravity]))
    slipping = tl.linearize(tl.Scene(robot, *state, [gravity, E.DryFriction({"elbow": 0.7}),
                                                     E.JointStops({"elbow": (-1.0, 1.0)})]))  # fmt: skip
    constant = tl.linearize(tl.Scene(robot, *state, [gravity, E.Torque({"elbow": 0.7})]))
    np.testing.assert_allclose(slipping.A, constant.A, atol=1e-12)
    np.testing.assert_allclose(slipping.a, constant.a, atol=1e-12)
    assert np.abs(slipping.A - plain.A).max() > 0.1


def test_a_wrong_formula_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    original = smooth.derivatives_of

    def off(*arguments: object) -> tuple[np.ndarray, np.ndarray]:
        a, slope = original(*arguments)
        slope[0, 0, 0] += 1e-4
        return a, slope

    monkeypatch.setattr("twolink.parts.design.linearization.derivatives_of", off)
    with pytest.raises(CertificationError, match="differ"):
        tl.linearize(tl.load_scene("arm-swing"))


def test_what_inputs_reach() -> None:
    """Two pendulums that do not touch: a motor at one does not reach the other."""
    scene = tl.Scene(tl.load_robot("two_link"), [-np.pi / 2, 0.0], effects=[E.Gravity()])
    assert tl.linearize(scene, inputs=["elbow"]).controllability.rank == 4
    weightless = tl.Scene(tl.load_robot("two_link"))
    found = tl.linearize(weightless, inputs=["elbow"]).controllability
    assert (found.rank, found.size) == (2, 4)  # without gravity the whole arm's angle is not moved on its own
    assert found.dropped <= found.tolerance < found.kept


class Step(E.Effect, frozen=True):
    """A constant torque on either side of an angle."""

    analytic: ClassVar[bool] = False
    below: float = 0.0
    above: float = 50.0

    def act(self, motion: Any, loads: Any) -> None:
        loads.torque(0, motion.xp.where(motion.xp.less(motion.q[0], 0.0), self.below, self.above))


@pytest.mark.parametrize(("angle", "torque"), [(-0.4, -3.0), (0.4, 50.0)])
def test_branches_that_are_constants_are_constant_torques(angle: float, torque: float) -> None:
    def scene(effect: E.Effect) -> tl.Scene:
        return tl.Scene(tl.load_robot("two_link"), [angle, 0.5], [0.3, -0.2], [E.Gravity(), effect])

    ours, constant = (tl.linearize(scene(effect)) for effect in (Step(below=-3.0), E.Torque({"shoulder": torque})))
    np.testing.assert_allclose(ours.A, constant.A, rtol=0, atol=ours.error + constant.error)
    np.testing.assert_allclose(ours.a, constant.a, rtol=1e-12)
    with_step = tl.equilibria(scene(Step(below=0.0)))
    assert len(with_step) == 2  # where it hangs, and beside it with the elbow turned
    np.testing.assert_allclose([one.q[0] for one in with_step], -np.pi / 2, atol=1e-9)


def test_arguments() -> None:
    scene = tl.load_scene("arm-swing")
    with pytest.raises(SceneError, match="elbw") as caught:
        tl.linearize(scene, inputs=["elbw"])
    assert caught.value.argument == "inputs"
    with pytest.raises(SceneError, match="inputs: expected texts, got 5"):
        tl.linearize(scene, inputs=5)
    with pytest.raises(SceneError, match="no equilibrium"):
        _ = tl.linearize(scene).stability
    with pytest.raises(tl.errors.QueryError, match="shape"):
        tl.linearize(scene, [0.0, 0.0, 0.0])
    with pytest.raises(SceneError, match="state"):
        _ = tl.linearize(scene, np.zeros((3, 2))).eigenvalues
    with pytest.raises(SceneError, match="at least one"):
        tl.linearize(scene, np.zeros((0, 2)))


@pytest.mark.parametrize("ask", [tl.linearize, tl.equilibria, lambda scene: tl.periodic_motion(scene, 1.0),
                                 tl.accuracy_study, lambda scene: tl.sensitivities(scene, wrt=["q"])])  # fmt: skip
def test_what_is_asked_of_a_motion_is_refused_where_nothing_moves(ask: Callable[[tl.Scene], object]) -> None:
    scene = tl.Scene(tl.load_robot("heavy_top"), effects=[E.Gravity()], duration=1.0)
    with pytest.raises(SceneError, match="nothing moves"):
        ask(scene)


def test_a_loop_that_was_released_holds_no_longer() -> None:
    """From the release on it is the scene without it: q was moved onto the loop, A was of what that left to move."""
    free = tl.Scene(tl.load_robot("arm"), [0.3, 0.5], effects=[E.Gravity()])
    elbow = tuple(free.robot.frame_pose(free.q, "forearm")[1].tolist())
    held = free.with_effects([E.Gravity(), E.Release(E.PointLoop("forearm", point_b=elbow), at=0.5)])
    run = tl.simulate(held, t_eval=[0.0, 0.25, 0.8])
    before, after = (tl.linearize(held, run.q[i], run.v[i], t=run.t[i]) for i in (1, 2))
    assert before.A.shape == (2, 2)
    np.testing.assert_array_equal(after.q, run.q[2])
    np.testing.assert_allclose(after.A, tl.linearize(free, run.q[2], run.v[2]).A, rtol=1e-12)
    with pytest.raises(SceneError, match="released"):
        tl.linearize(held, run.q, run.v, t=run.t)
