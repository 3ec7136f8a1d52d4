"""equilibria: all of small arms, each once, with the stability that closed forms give."""

from collections import Counter

import numpy as np

import twolink as tl
from tests.refusals import refusal
from tests.urdf_text import joint, link
from tests.urdf_text import robot_of as robot_text
from twolink.errors import SceneError

E = tl.effects
ARM = tl.load_robot("two_link")


def test_the_arm_has_four() -> None:
    """Hanging and upright, straight and folded: q = (+-90 deg, 0 or 180 deg)."""
    found = tl.equilibria(tl.Scene(ARM, effects=[E.Gravity()]), starts=24)
    expected = {(-np.pi / 2, 0.0): "centre", (-np.pi / 2, np.pi): "saddle", (np.pi / 2, np.pi): "saddle",
                (np.pi / 2, 0.0): "saddle"}  # fmt: skip
    assert len(found) == 4
    for (q, stability), each in zip(expected.items(), found, strict=True):
        np.testing.assert_allclose(each.q, q, atol=1e-12)
        assert each.stability == stability
    assert [int((each.eigenvalues.real > each.eigenvalue_errors).sum()) for each in found] == [0, 1, 1, 2]
    assert "centre" in str(found)
    few = tl.equilibria(tl.Scene(ARM, effects=[E.Gravity()]), starts=0)
    np.testing.assert_allclose(few[0].q, [-np.pi / 2, 0.0], atol=1e-12)  # hanging is found without luck


def test_equilibria_beyond_stops_are_left_out() -> None:
    """Of the arm's four those within; 3 pi / 2 may be within stops where -pi / 2 is not."""

    def found(**limits: tuple[float, float]) -> list[list[float]]:
        scene = tl.Scene(ARM, [2.0, 0.1], effects=[E.Gravity(), E.JointStops(limits)])
        return sorted(each.q.round(9).tolist() for each in tl.equilibria(scene, starts=48))

    down, up, over = round(-np.pi / 2, 9), round(np.pi / 2, 9), round(3 * np.pi / 2, 9)
    assert found(elbow=(-1.0, 1.0)) == [[down, 0.0], [up, 0.0]]
    assert found(shoulder=(0.5, 6.0), elbow=(-1.0, 1.0)) == [[up, 0.0], [over, 0.0]]
    with refusal(SceneError, code="beyond-stop"):
        tl.equilibria(tl.Scene(ARM, [2.0, 0.1], effects=[E.Gravity(), E.JointStops({"elbow": (-1.0, 1.0)})]),
                      [-np.pi / 2, np.pi])  # fmt: skip


def test_those_left_out_are_counted() -> None:
    """Of the arm's four, two are beyond a stop of the elbow; friction holds all, so none has derivatives."""
    stops = E.JointStops({"elbow": (-1.0, 1.0)})
    for effect, left in ((stops, 2), (E.DryFriction({"elbow": 0.5}), 4)):
        found = tl.equilibria(tl.Scene(ARM, [2.0, 0.1], effects=[E.Gravity(), effect]), starts=24)
        assert (len(found), found.left_out) == (4 - left, left)
        assert f"{left} left out" in str(found)
    assert "left out" not in str(tl.equilibria(tl.Scene(ARM, effects=[E.Gravity()]), starts=4))


def test_damping_decides_at_the_lowest() -> None:
    damped = tl.Scene(ARM, effects=[E.Gravity(), E.JointDamping({"shoulder": 0.5})])
    assert tl.equilibria(damped, [-1.5, 0.1])[0].stability == "asymptotically stable"


def test_a_spring_moves_them_and_counts_turns() -> None:
    """k (q - q0) = -m g l cos q for one joint: the roots, found by bisection, each with its slope's sign."""
    scene = tl.Scene(ARM, effects=[E.Gravity(), E.JointSpring({"shoulder": 6.0, "elbow": 400.0}, {"shoulder": 0.5})])
    found = tl.equilibria(scene, starts=24)
    assert len(found) >= 3
    for each in found:
        q = each.q
        gravity = scene.robot.gravity_torque(q)
        np.testing.assert_allclose(gravity, [-6.0 * (q[0] - 0.5), -400.0 * q[1]], atol=1e-8)
        stiffness = -scene.robot.mass_matrix(q) @ each.A[2:, :2]
        assert (each.stability == "centre") == bool((np.linalg.eigvalsh(stiffness) > 0).all())
    assert Counter(each.stability for each in found)["centre"] >= 2
    assert len({tuple(each.q.round(5)) for each in found}) == len(found)


def test_a_line_of_equilibria_has_unknown_stability() -> None:
    weightless = tl.Scene(ARM, effects=[E.Gravity(), E.GravityCompensation(), E.JointSpring({"elbow": 3.0})])
    (found,) = tl.equilibria(weightless, [0.3, 0.4])
    np.testing.assert_allclose(found.q[1], 0.0, atol=1e-12)
    assert found.stability == "unknown"


def test_negative_damping_is_unstable() -> None:
    gain = {"shoulder": (9.0, 0.0, -1.0, 0.0), "elbow": (0.0, 9.0, 0.0, -1.0)}
    (found,) = tl.equilibria(tl.Scene(ARM, effects=[E.StateFeedback(gain, (0.3, 0.2))]), [0.2, 0.1])
    np.testing.assert_allclose(found.q, [0.3, 0.2], atol=1e-12)
    assert found.stability == "unstable"


def test_without_equilibria() -> None:
    pushed = tl.Scene(ARM, effects=[E.Torque({"shoulder": 3.0})])
    assert len(tl.equilibria(pushed, starts=4)) == 0
    with refusal(SceneError, code="no-equilibrium"):
        tl.equilibria(pushed, [0.0, 0.0])
    with refusal(SceneError, code="depends-on-time"):
        tl.equilibria(tl.Scene(ARM, effects=[E.Torque({"shoulder": E.Sine(1.0, 2.0)})]))


SPRING = E.JointSpring({"shoulder": 50.0}, rest={"shoulder": 1.0})


def test_what_waits_for_a_condition_does_not_act() -> None:
    """The arm rests where it hangs and stands; from a guess on the condition itself the forces have no derivatives."""
    effects = [E.Gravity(), E.Engage(SPRING, when=E.JointReaches("elbow", 2.0))]
    found = tl.equilibria(tl.Scene(ARM, effects=effects), starts=16)
    assert len(found) == 4
    np.testing.assert_allclose(np.cos([one.q[0] for one in found]), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.sin([one.q[1] for one in found]), 0.0, atol=1e-9)
    (near,) = tl.equilibria(tl.Scene(ARM, effects=effects), [1.5, 0.1])
    np.testing.assert_allclose(near.q, [np.pi / 2, 0.0], atol=1e-9)
    begun = [E.Gravity(), E.Engage(E.Torque({"elbow": 1.0}), when=E.JointReaches("elbow", 0.0))]
    with refusal(SceneError, code="not-differentiable"):
        tl.equilibria(tl.Scene(ARM, effects=begun), [1.5, 0.1])


def test_what_begins_or_ceases_at_a_time_leaves_no_equilibrium() -> None:
    for timed in (E.Engage(SPRING, at=9.0), E.Release(SPRING, at=9.0)):
        with refusal(SceneError, code="depends-on-time"):
            tl.equilibria(tl.Scene(ARM, effects=[E.Gravity(), timed]))


def test_one_on_a_limit_of_effort_does_not_end_the_search() -> None:
    """Compensated gravity leaves an equilibrium wherever the torque is within its limit."""
    found = tl.equilibria(tl.Scene(ARM, effects=[E.Gravity(), E.GravityCompensation(effort={"elbow": 3.0})]))
    assert len(found) > 10
    assert max(abs(ARM.gravity_torque(one.q)[1]) for one in found) < 3.0


def test_damping_of_one_of_two_uncoupled_sliders_is_stable() -> None:
    """The other one oscillates for ever: its eigenvalues are imaginary."""
    text = robot_text(link("a"), link("b"), joint("x", "prismatic", "ground", "a", "1 0 0"),
                      joint("y", "prismatic", "a", "b", "0 1 0"))  # fmt: skip
    robot = tl.load_robot(text)
    effects = [E.JointSpring({"x": 3.0, "y": 2.0}), E.JointDamping({"x": 0.5})]
    assert tl.equilibria(tl.Scene(robot, effects=effects), [0.1, 0.2])[0].stability == "stable"
