"""Robots whose inertias are not known yet: kinematics and the regressor answer, dynamics waits for identify."""

import pickle
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.identification.motions import motion, noisy
from tests.refusals import refusal
from twolink.errors import QueryError, RobotError
from twolink.identification import identify, write_urdf
from twolink.parts.identification.measurements import Measurements
from twolink.parts.identification.setup import derivatives, setup_of

ARM = tl.load_robot("arm")
BARE = re.sub(r"<inertial>.*?</inertial>", "", ARM.visuals.text, flags=re.DOTALL)
T, Q, V, A = motion(ARM)
TAU = ARM.inverse_dynamics(Q, V, A)


def test_dynamics_is_refused_by_name_and_kinematics_answer() -> None:
    with refusal(RobotError, code="no-inertia", match='purpose="kinematics"'):
        tl.load_robot(BARE)
    bare = tl.load_robot(BARE, purpose="kinematics")
    np.testing.assert_allclose(bare.frame_jacobian(Q, "forearm"), ARM.frame_jacobian(Q, "forearm"), atol=1e-14)
    np.testing.assert_allclose(bare.regressor(Q, V, V), ARM.regressor(Q, V, V), atol=1e-12)
    for call in (bare.forward_dynamics, bare.inverse_dynamics):
        for rows in (slice(None), 0):
            with refusal(QueryError, code="no-inertia", match="move no inertia"):
                call(Q[rows], V[rows], V[rows])
    for query in (bare.mass_matrix, bare.gravity_torque, lambda _: bare.compiled()):
        with pytest.raises(QueryError, match="identify it first"):
            query(Q)
    with pytest.raises(QueryError, match="move no inertia"):
        tl.Scene(bare)
    assert pickle.loads(pickle.dumps(bare)).weightless == bare.weightless
    assert "dynamics is refused" in str(bare.report)


def test_a_robot_without_inertias_is_identified_and_then_has_dynamics(tmp_path: Path) -> None:
    bare = tl.load_robot(BARE, purpose="identification")
    found = identify(bare, T, Q, V, noisy(TAU, 0.02), a=A)
    assert found.consistency.consistent
    np.testing.assert_allclose(found.found.inverse_dynamics(Q, V, A), TAU, rtol=0, atol=0.03)
    again = tl.load_robot(write_urdf(found, BARE, tmp_path / "found.urdf"))
    np.testing.assert_allclose(again.forward_dynamics(Q, V, TAU), A, rtol=0, atol=0.3)


@pytest.mark.parametrize(("parameters", "deviation"), [(["forearm.*"], 0.02), (None, 3.0)])
def test_a_fit_may_leave_joints_that_move_no_inertia(parameters: list[str] | None, deviation: float) -> None:
    # One link alone, or noise in which the estimate is no body.
    bare = tl.load_robot(BARE, purpose="identification")
    found = identify(bare, T, Q, V, noisy(TAU, deviation), parameters, a=A, joint_model="viscous+coulomb")
    assert np.isfinite(found.estimate).all()
    assert np.isfinite(found.found.regressor(Q, V, A) @ found.found.parameter_values).all()


@pytest.mark.parametrize("given", [(1.0, 0.3, 0.3, 0.5), (0.3, 0.01, 0.02, 0.5), (0.0, 0.0, 0.0, 0.0)])
def test_found_is_of_bodies_that_exist_where_no_body_has_what_was_given(given: Sequence[float], tmp_path: Path) -> None:
    """A planar arm's motion shows neither xx nor yy, and a point on its axis moves no inertia.

    Both are in public URDFs, of a TIAGo and a TX40, and were in what was found.
    """
    arm = tl.load_robot("two_link")
    begin, middle, end = arm.visuals.text.rpartition("<inertial>")
    ixx, iyy, izz, lever = given
    _, _, rest = end.partition("</inertial>")
    odd = (f'<origin xyz="{lever} 0 0"/><mass value="1"/>'
           f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>')  # fmt: skip
    text = begin + middle + odd + rest
    robot = tl.load_robot(text, purpose="identification", unphysical="report")
    t, q, v, a = motion(arm)
    found = identify(robot, t, q, v, noisy(arm.inverse_dynamics(q, v, a), 0.02), a=a)
    again = tl.load_robot(write_urdf(found, text, tmp_path / "found.urdf"))  # which refuses impossible bodies
    assert np.linalg.eigvalsh(again.mass_matrix(again.random_state(20)[0])).min() > 1e-2
    np.testing.assert_allclose(again.inverse_dynamics(q, v, a), arm.inverse_dynamics(q, v, a), rtol=0, atol=0.05)


def test_derivatives_by_a_setup_need_no_bodies() -> None:
    """Central differences of Y pi by q and by gravity, for ten numbers of each link that no body has."""
    robot = tl.load_robot(BARE, purpose="identification")
    t, q, v, a = motion(robot, 20)
    pi = np.random.default_rng(3).normal(size=len(robot.parameter_names))
    pi[0], pi[20:] = 0.0, 0.0  # a link without mass whose first moment is not 0; no friction
    setup = setup_of(robot, ["elbow.zero", "gravity"])
    data = Measurements(t, q, v, a, 0 * v, (len(t),))
    slopes = derivatives(setup, pi, setup.names, data, 0 * v)
    step = 1e-5

    def torques(values: list[float]) -> np.ndarray:
        moved = replace(setup, values=np.array(values))
        return np.asarray(moved.true_robot.regressor(moved.position(q), v, a) @ pi)

    for k in range(len(setup.names)):
        unit = step * np.eye(len(setup.names))[k]
        expected = (torques((unit).tolist()) - torques((-unit).tolist())) / (2 * step)
        np.testing.assert_allclose(slopes[..., k], expected, atol=1e-7)
