"""Equations by hand beside Pinocchio's: right ones pass in every coordinates, and each mistake is found and mended."""

from __future__ import annotations

import dataclasses
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.errors import QueryError
from twolink.lagrange.equation_check import EquationCheck

Array = np.ndarray
ARM = tl.load_robot("two_link")
M1, M2, L1, L2, G = 3.0, 1.0, 1.0, 1.0, 9.81


def mass(q: Array) -> list[list[float]]:
    """The arm's mass matrix, by hand, angles from the horizontal and from the upper arm."""
    coupling, own = M2 * L1 * L2 * np.cos(q[1]) / 2, M2 * L2**2 / 3
    return [[M1 * L1**2 / 3 + M2 * L1**2 + own + 2 * coupling, own + coupling], [own + coupling, own]]


def bias(q: Array, v: Array, c21: float = 1.0, product: float = 1.0, weight: tuple[float, float] = (1, 1)) -> Array:
    """The arm's bias, by hand; right with factors of 1."""
    bent, forearm = M2 * L1 * L2 * np.sin(q[1]) / 2, M2 * G * L2 / 2 * np.cos(q[0] + q[1])
    velocity = np.array([-bent * (2 * product * v[0] * v[1] + v[1] ** 2), c21 * bent * v[0] ** 2])
    return velocity + np.multiply(weight, [(M1 / 2 + M2) * G * L1 * np.cos(q[0]) + forearm, forearm])


def times(i: int, k: int, factor: float) -> Callable[[Array], Array]:
    """The mass matrix with one entry that is wrong by a factor."""

    def wrong(q: Array) -> Array:
        out = np.array(mass(q))
        out[i, k] *= factor
        return out

    return wrong


def wrong_entries(report: EquationCheck) -> dict[str, dict[str, float]]:
    return {entry.entry: dict(entry.factors) for entry in report.wrong}


def test_equations_by_hand_are_right() -> None:
    report = tl.check_equations(mass, bias, "two_link")
    assert report.right
    assert [entry.entry for entry in report.entries] == ["M[0,0]", "M[0,1]", "M[1,0]", "M[1,1]", "h[0]", "h[1]"]
    assert max(entry.difference for entry in report.entries) < 1e-13
    assert report.coordinates.startswith("the robot's own")
    assert "the equations are right" in str(report)
    assert report == tl.check_equations(mass, bias, ARM)  # the same states each time


MISTAKES = {
    "sign of M01": (times(0, 1, -1.0), bias, {"M[0,1]": {"": -1.0}}, "times -1"),
    "m l^2/2 for m l^2/3": (times(1, 1, 1.5), bias, {"M[1,1]": {"": 2 / 3}}, "times 2/3"),
    "sign of one weight": (mass, lambda q, v: bias(q, v, weight=(1, -1)), {"h[1]": {"the gravity term": -1.0}},
                           "the gravity term has the wrong sign"),
    "sign of C21": (mass, lambda q, v: bias(q, v, c21=-1), {"h[1]": {"the term of v[0]^2": -1.0}},
                    "the term of v[0]^2 has the wrong sign"),
    "Coriolis without its 2": (mass, lambda q, v: bias(q, v, product=0.5), {"h[0]": {"the term of v[0] v[1]": 2.0}},
                               "the term of v[0] v[1]: times 2"),
    "degrees for the weight": (mass, lambda q, v: bias(q, v, weight=(np.pi / 180, 1)),
                               {"h[0]": {"the gravity term": 180 / np.pi}}, "the gravity term: times 57.2958"),
    "all of h[0] halved": (mass, lambda q, v: bias(q, v) * [0.5, 1], {"h[0]": {"": 2.0}}, "times 2"),
    "speeds of h[0] halved": (mass, lambda q, v: (bias(q, v) + bias(q, 0 * v) * [1, 0]) * [0.5, 1],
                              {"h[0]": {"the velocity terms": 2.0}}, "the velocity terms: times 2"),
    "a term too much": (mass, lambda q, v: bias(q, v) + np.array([0, v[1] ** 2]), {"h[1]": {"the term of v[1]^2": 0.0}},
                        "the term of v[1]^2 must be 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_found_with_what_mends_it(name: str) -> None:
    M, h, expected, words = MISTAKES[name]
    report = tl.check_equations(M, h, ARM)
    found = wrong_entries(report)
    assert not report.right
    assert found.keys() == expected.keys()
    for entry, factors in expected.items():
        assert found[entry] == pytest.approx(factors, rel=1e-12)
    assert [entry.mend for entry in report.wrong] == [words]
    assert all(entry.mended for entry in report.wrong)
    assert report.wrong[0].difference > 1e-3
    assert f"WRONG: {words}" in str(report)


def test_what_is_missing_or_not_to_be_mended_is_said() -> None:
    printed = tl.lagrange.two_link((L1, L2), (M1, M2), variant="printed")
    report = tl.check_equations(printed.mass_matrix, printed.bias, ARM)  # C21 = 0, C22 = -C12
    assert [entry.mend for entry in report.wrong] == ["the term of v[0]^2 is missing; the term of v[1]^2 must be 0"]
    assert not report.wrong[0].mended
    steiner = tl.check_equations(lambda q: np.subtract(mass(q), [[M2 * L1**2, 0], [0, 0]]), bias, ARM)
    assert [(entry.entry, entry.mend, entry.mended) for entry in steiner.wrong] == [("M[0,0]", "plus 1", True)]
    lossy = tl.check_equations(mass, lambda q, v: bias(q, v) + 0.3 * v, ARM)
    assert [entry.entry for entry in lossy.wrong] == ["h[0]", "h[1]"]
    assert all("friction?" in entry.mend and not entry.mended for entry in lossy.wrong)
    odd = tl.check_equations(lambda q: np.add(mass(q), [[0, 0], [0, np.sin(q[0])]]), bias, ARM)
    assert [entry.mend for entry in odd.wrong] == ["no constant factor mends it"]


def test_rounded_numbers_hide_neither_what_is_right_nor_a_mistake() -> None:
    def turned(q: Array, v: Array, c21: float = 1.0) -> Array:
        return bias(np.add(q, [3.141593 - np.pi, 0]), v, c21)

    right = tl.check_equations(mass, turned, ARM)
    assert [entry.entry for entry in right.wrong] == ["h[0]", "h[1]"]
    assert all(entry.rounded and entry.mended for entry in right.wrong)
    assert not right.right
    assert "the equations are right, but for rounded numbers in h[0], h[1]" in str(right)
    assert "WRONG" not in str(right)
    wrong = tl.check_equations(mass, lambda q, v: turned(q, v, c21=-1), ARM)
    assert [entry.factors for entry in wrong.wrong] == [{}, {"the term of v[0]^2": -1.0}]
    assert wrong.wrong[1].mend == "the term of v[0]^2 has the wrong sign, then right but for rounded numbers"
    assert "h[1] is wrong, at 20" in str(wrong)


def test_the_limit_is_a_billionth() -> None:
    assert tl.check_equations(times(0, 0, 1 + 1e-11), bias, ARM).right
    assert wrong_entries(tl.check_equations(times(0, 0, 1 + 1e-7), bias, ARM)).keys() == {"M[0,0]"}
    assert wrong_entries(tl.check_equations(mass, lambda q, v: bias(q, v) * (1 + 1e-7), ARM)).keys() == {"h[0]", "h[1]"}


@pytest.mark.parametrize("factor", [2.0, 1 + 1e-7])
def test_a_mistake_of_a_light_joint_beside_a_heavy_one_is_found(factor: float) -> None:
    """An upright flywheel of I = 1e-8 kg m^2 on a heavy arm: by hand, M = diag(J, I) and h[1] = 0."""
    urdf = robot_of(
        link("arm", 1000.0, (0.0, 250.0, 250.0), "0.5 0 0"), joint("shoulder", "revolute", "ground", "arm", "0 -1 0"),
        link("wheel", 1e-3, 1e-8), joint("spin", "revolute", "arm", "wheel", "0 0 1"),
    )  # fmt: skip

    def check(own: float, product: float = 0.0) -> dict[str, dict[str, float]]:
        return wrong_entries(tl.check_equations(
            lambda _: [[500 + 1e-8, 0], [0, own]], lambda q, v: [500 * G * np.cos(q[0]), product * v[0] * v[1]], urdf
        ))  # fmt: skip

    assert check(1e-8) == check(1e-8 * (1 + 1e-12)) == {}
    assert check(1e-8 * factor) == {"M[1,1]": {"": pytest.approx(1 / factor)}}
    assert check(1e-8, 1e-8) == {"h[1]": {"the term of v[0] v[1]": 0.0}}


def absolute(zero: float = 0.0) -> tuple[Callable, Callable]:
    """The double pendulum of textbooks: both angles from one direction, itself at the angle -`zero`."""

    def mass_of(x: Array) -> Array:
        coupling = M2 * L1 * L2 * np.cos(x[0] - x[1]) / 2
        return np.array([[(M1 / 3 + M2) * L1**2, coupling], [coupling, M2 * L2**2 / 3]])

    def bias_of(x: Array, v: Array) -> Array:
        turn = M2 * L1 * L2 * np.sin(x[0] - x[1]) / 2
        weights = np.array([(M1 / 2 + M2) * G * L1, M2 * G * L2 / 2]) * np.cos(x - zero)
        return np.array([turn * v[1] ** 2, -turn * v[0] ** 2]) + weights

    return mass_of, bias_of


def relative(zero: float) -> tuple[Callable, Callable]:
    """The first angle from a vertical, the second from the first link."""
    return mass, lambda x, v: bias(x - [zero, 0], v)


T, DOWN = np.array([[1.0, 0.0], [-1.0, 1.0]]), np.pi / 2
COORDINATES = {
    "absolute angles;": (absolute(), "absolute", T),
    "absolute angles from the downward vertical;": (absolute(DOWN), "absolute vertical",
                                                    np.column_stack([T, [-DOWN, 0]])),
    "absolute angles from the upward vertical;": (absolute(-DOWN), ["vertical", "absolute"],
                                                  np.column_stack([T, [DOWN, 0]])),
    "angles from the downward vertical;": (relative(DOWN), "vertical", [[1, 0, -DOWN], [0, 1, 0]]),
    "angles from the upward vertical;": (relative(-DOWN), "upright", [[1, 0, DOWN], [0, 1, 0]]),
}  # fmt: skip


@pytest.mark.parametrize("words", COORDINATES)
def test_coordinates_are_found_and_can_be_given(words: str) -> None:
    equations, names, matrix = COORDINATES[words]
    found = tl.check_equations(*equations, ARM)
    assert found.right, found
    assert found.found
    assert found.coordinates.startswith(words)
    for given in (names, matrix):
        assert tl.check_equations(*equations, ARM, to=given).right
    assert not tl.check_equations(*equations, ARM, to="own").right


def test_a_mistake_is_found_in_coordinates_that_are_found() -> None:
    M, h = absolute(DOWN)
    report = tl.check_equations(M, lambda x, v: h(x, v) * [1, -1] + 2 * h(x, 0 * v) * [0, 1], ARM)
    assert report.coordinates.startswith("absolute angles from the downward vertical;")
    assert wrong_entries(report) == {"h[1]": {"the term of v[0]^2": -1.0}}


def test_a_wrong_weight_from_the_vertical_is_right_from_the_other_one_until_it_is_named() -> None:
    equations = absolute(-DOWN)
    assert "upward" in tl.check_equations(*equations, ARM).coordinates
    report = tl.check_equations(*equations, ARM, to="absolute hanging")
    assert wrong_entries(report) == {name: {"the gravity term": -1.0} for name in ("h[0]", "h[1]")}


def test_absolute_angles_where_an_axis_points_the_other_way() -> None:
    text = (Path(__file__).parents[2] / "urdf" / "two_link.urdf").read_text("utf-8")
    robot = tl.load_robot(text[::-1].replace('"0 1- 0"', '"0 1 0"', 1)[::-1])  # the elbow's axis
    report = tl.check_equations(*absolute(), robot)
    assert report.right
    assert "q[1] = -x[1] + x[0]" in report.coordinates


def test_robots_of_any_size_and_continuous_joints() -> None:
    for name in ("ur5", "kinova"):  # the latter has cosines and sines in q, and angles in the equations
        robot = tl.load_robot(name)

        def configuration(x: Array, robot: tl.Robot = robot) -> Array:
            return robot.integrate(robot.neutral, x)

        def M(x: Array, robot: tl.Robot = robot, at: Callable = configuration) -> Array:
            return robot.mass_matrix(at(x))

        def h(x: Array, v: Array, robot: tl.Robot = robot, at: Callable = configuration) -> Array:
            return robot.bias(at(x), v) + 2 * robot.gravity_torque(at(x)) * (np.arange(robot.nv) == 1)

        report = tl.check_equations(M, h, robot)
        assert wrong_entries(report) == {"h[1]": {"the gravity term": pytest.approx(1 / 3)}}
        assert not report.found


def test_a_cart_with_a_pole_and_a_robot_without_weight() -> None:
    urdf = robot_of(
        link("cart", 2.0, 0.0),
        joint("rail", "prismatic", "ground", "cart", "1 0 0"),
        link("pole", 1.0, (0.0, 1 / 12, 1 / 12), "0.5 0 0"),
        joint("hinge", "revolute", "cart", "pole", "0 -1 0"),
    )

    def M(x: Array) -> list[list[float]]:
        return [[3, -np.sin(x[1]) / 2], [-np.sin(x[1]) / 2, 1 / 3]]

    def h(x: Array, v: Array) -> list[float]:
        return [-np.cos(x[1]) / 2 * v[1] ** 2, G / 2 * np.cos(x[1])]

    assert tl.check_equations(M, h, urdf).right
    afloat = tl.load_robot(urdf, gravity=(0, 0, 0))
    report = tl.check_equations(M, h, afloat)
    assert wrong_entries(report) == {"h[1]": {"": 0.0}} or wrong_entries(report) == {"h[1]": {"the gravity term": 0.0}}
    assert tl.check_equations(M, lambda x, v: h(x, v) * np.array([1, 0]), afloat).right


@pytest.mark.parametrize("tilt", [0.0, np.pi / 4, 0.01, np.pi / 2])
def test_a_chain_that_is_tilted_at_0_has_no_angles_from_a_vertical_by_name(tilt: float) -> None:
    """By hand h = m g l sin x from the downward vertical, of a rod that is `tilt` below the horizontal at q = 0."""
    place = f"{float(np.cos(tilt))} 0 {float(-np.sin(tilt))}"
    urdf = robot_of(link("rod", 1.0, 0.1, place), joint("pin", "revolute", "ground", "rod", "0 -1 0"))
    by_hand = lambda _: [[1.1]], lambda x, _: [G * np.sin(x[0])]
    assert tl.check_equations(*by_hand, urdf, to=[[1.0, tilt - np.pi / 2]]).right
    if tilt == 0.0:
        assert tl.check_equations(*by_hand, urdf, to="hanging").right
    else:
        with pytest.raises(QueryError, match="not horizontal at q = 0; give a matrix"):
            tl.check_equations(*by_hand, urdf, to="hanging")


def raising(*_: Array) -> Array:
    raise KeyError("l1")


def giving(value: object) -> Callable[..., object]:
    """A function with the same answer at every state."""
    return lambda *_: value


BAD = {
    "no function": ((3, bias), {}, r"M: expected a function, got 3; define M\(q\) -> \(nv, nv\)"),
    "shape of M": ((giving([1.0, 2.0]), bias), {}, r"M: expected shape \(2, 2\), got \(2,\), at q = \[.*nv = 2"),
    "shape of h": ((mass, giving([[1.0], [2.0]])), {}, r"h: expected shape \(2,\), got \(2, 1\), at q = .*, v = "),
    "not finite": ((mass, giving([0.0, np.nan])), {}, r"h: expected finite numbers, got nan at \[1\], at q = "),
    "complex": ((giving(np.eye(2) * 1j), bias), {}, "M: expected real numbers"),
    "ragged": ((giving([[1.0], [1.0, 2.0]]), bias), {}, "M: expected real numbers"),
    "nothing": ((giving(None), bias), {}, "M: expected"),
    "raises": ((raising, bias), {}, r"M: it raised KeyError: 'l1' \(test_equation_check.py, line \d+\), at q = "),
    "takes too few": ((mass, mass), {}, r"h: it raised TypeError: .*it is called as h\(q, v\) -> \(nv,\)"),
    "name": ((mass, bias), {"to": "absolut"}, "to: 'absolut' is unknown; did you mean 'absolute'"),
    "matrix": ((mass, bias), {"to": [[1.0, 0.0]]}, r"to: expected shape \(2, 2\) or \(2, 3\), got \(1, 2\)"),
    "no matrix": ((mass, bias), {"to": 5}, r"to: expected shape \(2, 2\) or \(2, 3\), got \(\)"),
    "no inverse": ((mass, bias), {"to": np.ones((2, 2))}, "to: the matrix has no inverse"),
    "not planar": ((mass, bias), {"to": "absolute", "robot": "ur5"}, "to: robot 'ur5' is no planar chain"),
    "no vertical": ((mass, bias), {"to": "vertical", "robot": tl.load_robot("two_link", gravity=(0, 0, 0))},
                    "to: robot 'two_link' is not horizontal at q = 0"),
    "free base": ((mass, bias), {"robot": tl.load_robot("anymal", root="free")}, "'root_joint' has 6 degrees"),
    "mimic": ((mass, bias), {"robot": tl.load_robot("panda", mimic=True)}, "robot: it has coupled joints"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_compared_is_refused_with_its_place(case: str) -> None:
    (M, h), options, message = BAD[case]
    with pytest.raises(QueryError, match=message) as refusal:
        tl.check_equations(M, h, **{"robot": ARM, **options})
    assert refusal.value.remedy


def test_functions_may_change_what_they_get() -> None:
    def M(q: Array) -> list[list[float]]:
        found = mass(q)
        q[:] = 0
        return found

    assert tl.check_equations(M, bias, ARM).right


def test_the_result_is_frozen_plain_data_and_a_text() -> None:
    report = tl.check_equations(times(0, 1, -1.0), bias, ARM)
    assert pickle.loads(pickle.dumps(report)) == report
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.robot = "other"
    data = json.loads(json.dumps(report.to_dict()))
    assert data["right"] is False
    assert data["entries"][1]["factors"] == {"": -1.0}
    lines = str(report).splitlines()
    assert lines[0].startswith("two_link: M[0,1] is wrong, at 20 random states beside Pinocchio")
    assert next(line for line in lines if line.startswith("M[0,1]")).endswith("WRONG: times -1")
