"""Robots whose inertias are not known yet: kinematics and the regressor answer, dynamics waits for identify."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.identification.motions import motion, noisy
from twolink.errors import QueryError, RobotError
from twolink.identification import identify, write_urdf

ARM = tl.load_robot("arm")
BARE = re.sub(r"<inertial>.*?</inertial>", "", ARM.visuals.text, flags=re.DOTALL)
Q, V = ARM.random_state(3)


def test_dynamics_is_refused_by_name_and_kinematics_answer() -> None:
    with pytest.raises(RobotError, match='purpose="kinematics"') as caught:
        tl.load_robot(BARE)
    assert caught.value.code == "no-inertia"
    bare = tl.load_robot(BARE, purpose="kinematics")
    np.testing.assert_allclose(bare.frame_jacobian(Q, "forearm"), ARM.frame_jacobian(Q, "forearm"), atol=1e-14)
    np.testing.assert_allclose(bare.regressor(Q, V, V), ARM.regressor(Q, V, V), atol=1e-12)
    for call in (bare.forward_dynamics, bare.inverse_dynamics):
        for rows in (slice(None), 0):
            with pytest.raises(QueryError, match="move no inertia") as refused:
                call(Q[rows], V[rows], V[rows])
            assert refused.value.code == "no-inertia"
    for query in (bare.mass_matrix, bare.gravity_torque, lambda _: bare.compiled()):
        with pytest.raises(QueryError, match="identify it first"):
            query(Q)
    with pytest.raises(QueryError, match="move no inertia"):
        tl.Scene(bare)
    assert pickle.loads(pickle.dumps(bare)).weightless == bare.weightless
    assert "dynamics is refused" in str(bare.report)


def test_a_robot_without_inertias_is_identified_and_then_has_dynamics(tmp_path: Path) -> None:
    bare = tl.load_robot(BARE, purpose="identification")
    t, q, v, a = motion(ARM)
    tau = ARM.inverse_dynamics(q, v, a)
    found = identify(bare, t, q, v, noisy(tau, 0.02), a=a)
    assert found.consistency.consistent
    np.testing.assert_allclose(found.found.inverse_dynamics(q, v, a), tau, rtol=0, atol=0.03)
    again = tl.load_robot(write_urdf(found, BARE, tmp_path / "found.urdf"))
    np.testing.assert_allclose(again.forward_dynamics(q, v, tau), a, rtol=0, atol=0.3)
