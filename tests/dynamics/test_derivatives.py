"""Derivatives of the dynamics against Pinocchio's, against finite differences, and compiled against themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.dynamics.robots import FOLLOWERS
from tests.dynamics.test_recursions import Case, close, make
from twolink.algorithms import derivatives, recursions
from twolink.algorithms.factors import ldlt, ldlt_inverse
from twolink.algorithms.mechanism import mechanism, nominal
from twolink.errors import QueryError

STATES = 4
STEP = 1e-6


def differences(case: Case, algorithm: Any, x: np.ndarray) -> list[np.ndarray]:
    """Central differences of our algorithm(q, v, x): (nv, nv, states) each, along q's tangent, v and x."""

    def moved(k: int, h: float) -> list[np.ndarray]:
        step = np.zeros_like(x)
        step[k] = h
        columns = zip(case.q.T, step.T, strict=True)
        q = np.stack([pin.integrate(case.model, a, b) for a, b in columns], axis=-1)
        points = ((q, case.v, x), (case.q, case.v + step, x), (case.q, case.v, x + step))
        return [case.dense(algorithm(*point)) for point in points]

    columns = []
    for k in range(case.model.nv):
        pairs = zip(moved(k, STEP), moved(k, -STEP), strict=True)
        columns.append([(ahead - behind) / (2 * STEP) for ahead, behind in pairs])
    return [np.stack(group, axis=1) for group in zip(*columns, strict=True)]


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["panda", "odd"])
def test_finite_differences(name: str) -> None:
    """Without Pinocchio's derivatives; damping and armature are those of every joint that can have them."""
    model = make(name)
    single = [model.names[j] for j in range(1, model.njoints) if model.joints[j].nv == 1]
    given = {f"{joint}.damping": 0.3 + 0.1 * n for n, joint in enumerate(single)}
    given |= {f"{joint}.armature": 0.2 + 0.1 * n for n, joint in enumerate(single)}
    case, mech = Case(model, STATES), mechanism(model, given)
    tau = case.dense(recursions.rnea(mech, case.q, case.v, case.a, None, np))
    for ours, algorithm, x in (
        (derivatives.inverse_dynamics_derivatives, recursions.rnea, case.a),
        (derivatives.forward_dynamics_derivatives, recursions.forward_dynamics_crba, tau),
    ):
        expected = differences(case, lambda q, v, x, f=algorithm: f(mech, q, v, x, None, np), x)
        for mine, theirs in zip(ours(mech, case.q, case.v, x, np), expected, strict=True):
            close(case.dense(mine), theirs, 1e-7)


def test_damping_enters_where_it_was_asked_for() -> None:
    model = make("odd")
    case, name = Case(model, STATES), "j_f.damping"
    k = model.joints[model.getJointId("j_f")].idx_v
    plain, damped = (
        [case.dense(m) for m in derivatives.inverse_dynamics_derivatives(mech, case.q, case.v, case.a, np)]
        for mech in (mechanism(model), mechanism(model, {name: nominal(model, name)}))
    )
    extra = np.zeros_like(plain[1])
    extra[k, k] = 0.7
    np.testing.assert_allclose(damped[1] - plain[1], extra, atol=1e-12)
    assert (damped[0] == plain[0]).all()
    assert (damped[2] == plain[2]).all()


def test_branches_do_not_touch() -> None:
    """Entries between branches are constants, not computed zeros, as are those of a sparse factor."""
    model = make("anymal")
    mech, case = mechanism(model), Case(model, 1)
    matrices = derivatives.inverse_dynamics_derivatives(mech, case.q, case.v, case.a, np)
    assert all(m[6][9] == 0.0 and type(m[6][9]) is float for m in matrices)
    assert type(ldlt(matrices[2], mech.dof_parents())[0][9][6]) is float


def test_sparse_inverse() -> None:
    """A tree of 5 degrees of freedom with integers, by hand: two branches on a common trunk of one."""
    parents = [-1, 0, 1, 0, 3]
    lower = np.eye(5)
    for i, j, x in ((1, 0, 2.0), (2, 0, -1.0), (2, 1, 3.0), (3, 0, 1.0), (4, 0, 4.0), (4, 3, -2.0)):
        lower[i, j] = x
    matrix = lower.T @ np.diag([1.0, 2.0, 4.0, 0.5, 8.0]) @ lower
    factor, reciprocal = ldlt(matrix.tolist(), parents)
    np.testing.assert_allclose(np.tril(factor, -1), np.tril(lower, -1), atol=1e-13)
    np.testing.assert_allclose(matrix @ np.array(ldlt_inverse(factor, reciprocal, parents)), np.eye(5), atol=1e-10)


def test_mimic_joints_are_refused() -> None:
    model = pin.buildModelFromXML(FOLLOWERS, True)
    case, mech = Case(model, 1), mechanism(model)
    for function in (derivatives.inverse_dynamics_derivatives, derivatives.forward_dynamics_derivatives):
        with pytest.raises(QueryError, match="derivatives are not available for mimic joints"):
            function(mech, case.q, case.v, case.a, np)
