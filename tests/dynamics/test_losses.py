"""Damping and friction of the robot's file in inverse dynamics: what they cost, and every face that offers them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer
from tests.dynamics.states import states
from tests.urdf_text import joint, link
from twolink.errors import QueryError

ARM = (Path(__file__).parents[2] / "urdf" / "two_link.urdf").read_text("utf-8")
LOSSY = ARM.replace('<axis xyz="0 -1 0"/>', '<axis xyz="0 -1 0"/><dynamics damping="0.7" friction="1.5"/>', 1)
ROBOT = tl.load_robot(LOSSY)  # the shoulder loses energy, the elbow does not


@pytest.mark.parametrize("engine", ["auto", "pinocchio", "compiled"])
def test_leading_axes_broadcast_and_friction_at_rest_is_zero(engine: str) -> None:
    speeds = np.array([-2.0, -0.0, 0.0, 3.0])[:, None] * [1.0, 1.0]
    lost = ROBOT.inverse_dynamics([0.3, 0.2], speeds, np.zeros((6, 1, 2)), engine=engine, losses=True)
    lost = lost - ROBOT.inverse_dynamics([0.3, 0.2], speeds, np.zeros((6, 1, 2)), engine=engine)
    assert lost.shape == (6, 4, 2)
    np.testing.assert_allclose(lost[..., 0], np.broadcast_to([-1.4 - 1.5, 0, 0, 2.1 + 1.5], (6, 4)), atol=1e-12)
    assert not lost[..., 1].any()


def test_damping_that_is_a_parameter_of_a_program_is_counted_once() -> None:
    q, v, a = states(ROBOT, 4, seed=6)
    program = ROBOT.compiled(parameters=["shoulder.damping"])
    d = np.array([0.0, 0.7, 1.0, 2.0])
    lost = program.inverse_dynamics(q, v, a, losses=True, parameters={"shoulder.damping": d})
    lost = lost - ROBOT.compiled().inverse_dynamics(q, v, a)
    np.testing.assert_allclose(lost[:, 0], d * v[:, 0] + 1.5 * np.sign(v[:, 0]), atol=1e-12)
    both = ROBOT.compiled().inverse_dynamics(q, v, a, losses=True), ROBOT.inverse_dynamics(q, v, a, losses=True)
    np.testing.assert_allclose(*both, rtol=1e-12)


def test_where_the_file_has_none_they_are_zero_and_the_report_says_so() -> None:
    said = "joints without damping and friction: losses=True adds 0 there: "
    assert f"{said}elbow\n" in str(ROBOT.report)
    assert "(in robot.model.damping; forward dynamics does not apply it, inverse dynamics with losses=True only): " \
           "shoulder" in str(ROBOT.report)  # fmt: skip
    bare = tl.load_robot("two_link")
    assert f"{said}shoulder, elbow\n" in str(bare.report)
    q, v, a = states(bare, 3, seed=1)
    assert np.array_equal(bare.inverse_dynamics(q, v, a, losses=True), bare.inverse_dynamics(q, v, a))


def test_what_cannot_be_added_is_refused() -> None:
    with pytest.raises(QueryError, match="losses: expected True or False, got 'yes'"):
        ROBOT.inverse_dynamics([0, 0], [0, 0], [0, 0], losses="yes")
    with pytest.raises(QueryError, match=r"losses: .*mimic=False"):
        tl.load_robot("panda", mimic=True).inverse_dynamics(np.zeros(8), np.zeros(8), np.zeros(8), losses=True)
    with pytest.raises(QueryError, match="not finite for state 1"):
        ROBOT.inverse_dynamics(np.zeros((2, 2)), [[0, 0], [1.7e308, 0]], [0, 0], losses=True)


def test_the_command_offers_them(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(LOSSY)
    (tmp_path / "states.json").write_text(json.dumps({"q": [[0.1, 0.2]] * 2, "v": [[0, 1], [-1, 1]]}))
    asked = ("query", str(tmp_path / "arm.urdf"), "inverse-dynamics", "--states", str(tmp_path / "states.json"))
    with_losses, without = answer(*asked, "--losses")["tau"], answer(*asked)["tau"]
    np.testing.assert_allclose(np.subtract(with_losses, without), [[0, 0], [-0.7 - 1.5, 0]], atol=1e-12)


@pytest.mark.parametrize("kind", ["planar", "floating", "spherical", "continuous"])
def test_the_report_says_which_friction_is_applied(kind: str) -> None:
    """Damping acts in every degree of freedom; friction only in joints of one, and the report says so."""
    last = joint("more", kind, "forearm", "more", more='<dynamics damping="2" friction="3"/>')
    robot = tl.load_robot(LOSSY.replace("</robot>", f"{link('more')}{last}</robot>"))
    (q,), (v,) = robot.random_state(1, seed=2)
    lost = robot.inverse_dynamics(q, v, 0 * v, losses=True) - robot.inverse_dynamics(q, v, 0 * v)
    rubbed = kind == "continuous"
    np.testing.assert_allclose(lost[2:], 2 * v[2:] + 3 * rubbed * np.sign(v[2:]), atol=1e-12)
    (said,) = [one.what for one in robot.report.ignored if "friction" in one.what and "more" in one.names]
    assert ("not applied" in said) == (not rubbed)
