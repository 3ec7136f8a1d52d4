"""Formulas of the derivatives of the dynamics: parameters, entries between branches, sparse factors, refusals."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.dynamics.robots import FOLLOWERS, ODD_JOINTS
from tests.dynamics.test_recursions import Case, make
from twolink.algorithms import derivatives
from twolink.algorithms.factors import ldlt, ldlt_inverse
from twolink.algorithms.mechanism import mechanism, nominal, parameter_names
from twolink.dynamics.certificates import BOUND
from twolink.errors import QueryError


@pytest.mark.parametrize("name", ["forward_dynamics_derivatives", "inverse_dynamics_derivatives"])
def test_damping_and_armature_that_are_parameters_enter(name: str) -> None:
    """Against the reference at values of their own in every state, which are shares of what the robot has."""

    def all_have_some(model: pin.Model) -> None:
        model.damping, model.armature = np.linspace(0.3, 0.9, model.nv), np.linspace(0.2, 0.6, model.nv)

    robot = tl.load_robot(ODD_JOINTS).changed(all_have_some)
    kept = [each for each in parameter_names(robot.model) if each.endswith((".damping", ".armature"))]
    assert all(nominal(robot.model, each) > 0.0 for each in kept)
    assert robot.compiled(kept).certificate(name).worst <= BOUND


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
