"""The paper's statements, held against laws and independent formulas; its figures by their numbers."""

import contextlib
import functools
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP, answer
from twolink.lagrange import two_link
from twolink.lagrange.check import arm_urdf
from twolink.paper.beyond import LIKE_FIGURE_6, first_swing, wrapped
from twolink.paper.claims import Claim, motion_claims
from twolink.paper.figures import draw
from twolink.paper.model_claims import equation_claims, formulation_claims
from twolink.paper.motions import MASSES, ArmMotion, by_hand, cycle_time, rate_by_hand
from twolink.paper.ode45 import ATOL, RTOL, defaults_study

CYCLE = cycle_time(by_hand(1.0, 4.0))


@functools.cache
def three_cycles(scale: float = 1.0) -> ArmMotion:
    return by_hand(scale, 3 * CYCLE * np.sqrt(scale))


def by_text(claims: tuple[Claim, ...] | list[Claim]) -> dict[str, bool | None]:
    return {claim.text: claim.holds for claim in claims}


EXERCISES = {
    1: ("my_a22", 1 / 3),
    3: ("my_weight", [29.43, 4.905]),
    7: ("my_c21", math.sin(0.5) / 2),
    13: ("my_entry", "h[1]"),
}


@pytest.mark.parametrize("cell", EXERCISES)
def test_the_exercise_says_right_or_wrong_and_keeps_the_truth_folded(cell: int) -> None:
    cells = json.loads((TOP / "docs" / "tutorials" / "paper_exercise.ipynb").read_text("utf-8"))["cells"]
    code = ["".join(each["source"]) for each in cells if each["cell_type"] == "code"]
    (name, right), printed = EXERCISES[cell], list[str]()
    for given in (None, 7.0, right):
        asked = code[cell].replace(f"{name} = None", f"{name} = {given!r}")
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec("\n".join((code[0], asked, code[cell + 1])), {})
        printed.append(out.getvalue())
    assert printed[:2] == ["no answer yet\n", "wrong\n"]
    assert printed[2] == "right\n" or "the term of v[0]^2 has the wrong sign" in printed[2]


def test_the_length_of_the_exercise_follows_from_the_cycle_that_it_gives() -> None:
    text = (TOP / "docs" / "tutorials" / "paper_exercise.ipynb").read_text("utf-8")
    given = float(re.search(r"With rods of 1 m it takes about ([\d.]+) s", text)[1])
    assert (3.0 / given) ** 2 == pytest.approx((3.0 / CYCLE) ** 2, abs=1e-3)


def test_figures_11_and_12_are_links_oriented_link_one_and_computerised_link_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fig. 10 link one, computerised; 11 link one, links oriented; 12 link two, computerised; 13 link two, ..."""
    drawn = []
    monkeypatch.setattr("twolink.paper.figures.save_figure", lambda figure, path: drawn.append(figure) or path)
    black, grey = three_cycles(), three_cycles(0.0625)
    draw(black, grey, "", tmp_path / "x.png")
    axes = drawn[0].axes[4:]
    for axis, number, motion, link in zip(axes, range(10, 14), (black, grey, black, grey), (0, 0, 1, 1), strict=True):
        model = "computerised" if motion is black else "links oriented"
        assert axis.get_title() == f"Fig. {number}: link {link + 1}, {model}"
        np.testing.assert_array_equal(axis.get_lines()[0].get_xdata(), motion.theta[:, link])
        np.testing.assert_array_equal(axis.get_lines()[0].get_ydata(), motion.dtheta[:, link])
    caption = drawn[0].get_suptitle()
    for part in ("l1 = 1 m", "l1 = 0.0625 m", "m1 = 3 kg", "1e-12", "1e-09 rad"):
        assert part in caption


def test_energies_of_the_links_are_those_of_their_bodies() -> None:
    """Against Pinocchio's velocities of the centres: m v^2/2 + m l^2/12 w^2/2, and m g z."""
    motion = by_hand(0.7, 1.0, (2.0, 1.5), ratio=1.3)
    robot = tl.load_robot(arm_urdf(0.7, 0.91, 2.0, 1.5))
    kinetic, potential = motion.link_energies()
    for i, (frame, length, mass) in enumerate((("upper_arm", 0.7, 2.0), ("forearm", 0.91, 1.5))):
        velocity = robot.frame_velocity(
            motion.theta, motion.dtheta, frame
        )  # along the world's axes, of the link's hinge
        angle = motion.theta[:, : i + 1].sum(axis=1)
        along = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
        centre = velocity[:, :3] + np.cross(velocity[:, 3:], 0.5 * length * along)
        moving = 0.5 * mass * (centre**2).sum(axis=1) + mass * length**2 / 24 * (velocity[:, 3:] ** 2).sum(axis=1)
        np.testing.assert_allclose(kinetic[:, i], moving, atol=1e-10)
        height = (0.7 * np.sin(motion.theta[:, 0]) if i else 0.0) + 0.5 * length * np.sin(angle)
        np.testing.assert_allclose(potential[:, i], mass * 9.81 * height, atol=1e-10)


def test_statements_about_the_motion() -> None:
    slow, fast = three_cycles((3.0 / CYCLE) ** 2), three_cycles((0.75 / CYCLE) ** 2)
    found = by_text(motion_claims(three_cycles(), slow, fast, CYCLE))
    assert found["theta1 stays below zero"]
    assert not found["theta2 stays below zero"]
    assert not found["link one's speed falls to zero at theta1 = -pi/2"]
    assert found["link one's speed is zero at -pi and 0, where it swings back"]
    assert found["at theta1 = 0 and -pi link two has its highest potential energy"]
    assert found["at theta1 = 0 and -pi link one has its lowest kinetic energy"]
    assert not found["at theta1 = -pi/2 link one has its highest kinetic energy"]
    assert found["at theta1 = -pi/2 link two has its highest kinetic energy"]
    assert found["the curves are identical but for frequency"]
    assert not found["the phase plots differ slightly in scale"]
    np.testing.assert_allclose(slow.theta, fast.theta, atol=1e-8)  # the same curve over t / sqrt(l)
    np.testing.assert_allclose(slow.dtheta, 0.25 * fast.dtheta, atol=1e-8)


def test_statements_about_the_equations_and_formulations() -> None:
    found = by_text([*equation_claims(), *formulation_claims()])
    assert not found["the moment of inertia of a link is m l^2/2"]
    assert found["A is the inertia matrix"]
    assert found["D is the torque of gravity"]
    assert not found["C is right as printed"]
    assert found["Coriolis torques are there because link one is a rotating frame for link two"]
    assert not found["nothing shows that Newton-Euler or Lagrange is better"]


def test_link_one_passes_minus_pi_for_some_proportions() -> None:
    """The map against single runs on either side of its boundary; the wrapped angle jumps by 2 pi, and back."""
    swing = first_swing(np.array([2.0, 3.0]), np.array([0.6, 1.0, 1.12]))
    np.testing.assert_array_equal(swing.passes, [[True, True, True], [True, False, False]])
    for i, mass in enumerate((2.0, 3.0)):
        for j, ratio in enumerate((0.6, 1.0, 1.12)):
            theta1, speed = (x[:, 0] for x in (by_hand(1.0, 2.6, (mass, 1.0), ratio=ratio).theta,
                                               by_hand(1.0, 2.6, (mass, 1.0), ratio=ratio).dtheta))  # fmt: skip
            turn = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0))[0]
            assert swing.lowest[i, j] == pytest.approx(theta1[: turn + 2].min(), abs=1e-4)
    example = by_hand(1.0, 7.6, **LIKE_FIGURE_6)
    angle = wrapped(example)
    assert angle.max() > 3.0
    np.testing.assert_allclose(np.unwrap(angle), example.theta[:, 0], atol=1e-12)
    assert (np.abs(np.diff(angle)) > 6.0).sum() == 6  # out and back in each of three cycles


def test_the_plain_rate_is_that_of_the_arm() -> None:
    x = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 4))
    for variant in ("corrected", "printed"):
        arm = two_link((0.7, 1.3), (2.0, 0.5), variant=variant)
        rate = rate_by_hand((0.7, 1.3), (2.0, 0.5), variant)
        expected = np.hstack([x[:, 2:], arm.forward_dynamics(x[:, :2], x[:, 2:], np.zeros(2))])
        np.testing.assert_allclose([rate(0.0, one) for one in x], expected, rtol=1e-12, atol=1e-12)


def test_ode45_at_its_defaults_keeps_two_digits() -> None:
    """Errors against an independent DOP853; tighter tolerances give more digits, and bars of `simulate` hold."""
    assert (RTOL, ATOL) == (1e-3, 1e-6)
    length = (3.0 / CYCLE) ** 2
    study = defaults_study(length, 9.0)
    end = by_hand(length, 9.0).theta[-1]
    np.testing.assert_allclose(study.right.theta[-1], end, atol=1e-9)
    np.testing.assert_allclose(study.off[-1], np.abs(study.drawn.theta[-1] - end), atol=1e-9)
    np.testing.assert_allclose(study.pair[0].error, study.off[-1], atol=1e-9)
    assert 1e-2 < study.off.max() < 0.2
    errors = [row.largest for row in study.pair]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-9
    for row in study.verified:
        assert row.bar is not None
        assert row.largest <= row.bar + study.known <= row.setting + study.known
    assert study.drawn.masses == MASSES


@pytest.mark.slow
def test_the_command_says_what_each_statement_is_worth(tmp_path: Path) -> None:
    done = answer("paper", "--out", str(tmp_path))
    verdicts = {claim["text"]: claim["holds"] for claim in done["claims"]}
    assert len(verdicts) >= 35
    assert done["difference"] < 1e-8
    assert verdicts["theta2 changes sign when theta1 = -pi/2, twice a cycle"]
    assert not verdicts["the links' velocities oppose each other"]
    assert verdicts["the motion nearly repeats with m1 : m2 = 3 : 1"]
    assert not verdicts["the motion nearly repeats with m1 : m2 = 1 : 1"]
    assert not verdicts["the C matrix as printed gives this motion"]
    assert not verdicts["ode45 at its defaults draws these curves right"]
    assert verdicts["link one swings beyond -pi, and its angle changes suddenly"]
    assert verdicts["SimMechanics is convenient where deriving the equations is cumbersome"] is None
    assert all(claim["where"] and claim["found"] for claim in done["claims"])
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "paper-same-parameters.png", "paper-cycles-3s-and-0.75s.png", "paper-beyond-pi.png", "paper-ode45.png"
    }  # fmt: skip
