"""Reverse mode: the same derivatives as forward mode, of formulas and of steps."""

import numpy as np
import pytest

import twolink as tl
from twolink.algorithms.duals import Dual, DualNamespace
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.reverse import NodeNamespace
from twolink.integrate.adjoint_steps import AdjointSteps
from twolink.integrate.scene_equations import equations_of, with_parameters
from twolink.integrate.variational_steps import VariationalSteps


def formula(a, b, c, xp):
    """All operations that formulas use, some values more than once."""
    first = xp.sin(a * b) + 2.0 * xp.cos(c) - a / b + 3.0 / c
    second = xp.where(xp.less(a, b), xp.sqrt(a + b), xp.tanh(a)) * first - xp.power(c, 3.0)
    return [first, second, -(1.0 - second) * xp.reciprocal(b) + 0.5, xp.where(xp.less(b, a), a, 1.5), 7.0]


@pytest.mark.parametrize("values", [(0.3, 1.2, 0.7), (1.4, 0.9, -0.6)])
def test_formulas_have_the_derivatives_of_forward_mode(values: tuple[float, ...]) -> None:
    weights = [0.7, -1.1, 0.4, 2.0, 5.0]
    duals = [Dual(np.float64(x), list(unit)) for x, unit in zip(values, np.eye(3), strict=True)]
    rows = [y.tangents if isinstance(y, Dual) else (0.0,) * 3 for y in formula(*duals, DualNamespace(Numbers))]
    xp = NodeNamespace(Numbers)
    nodes = [xp.node(np.float64(x)) for x in values]
    pulled = xp.pulled_back(formula(*nodes, xp), weights, nodes)
    np.testing.assert_allclose(pulled, np.array(weights) @ np.array(rows, dtype=float), rtol=1e-14)


def test_transposed_steps_add_what_the_steps_themselves_say() -> None:
    """w^T (dx_new/dp) of random steps of a thrown body with a quaternion, by the matrices and by the adjoint."""
    robot = tl.load_robot("spinning_box", root="free")
    scene = tl.Scene(robot, v=[0.3, -0.2, 1.0, 1.0, -2.0, 0.5], effects=[tl.effects.Gravity()])
    mass = next(name for name in robot.parameter_names if name.endswith(".mass"))
    names = (mass.replace("mass", "inertia.xx"), mass.replace("mass", "com.x"), "gravity.z")
    equations = with_parameters(equations_of(scene), names)
    random = np.random.default_rng(0)
    q, v = robot.random_state(5, seed=2)
    x, t = np.concatenate([q, v], axis=1).T, random.uniform(0.0, 1.0, 5)
    end, w = t + random.uniform(0.01, 0.1, 5), random.normal(size=(12, 5))
    matrices, _ = VariationalSteps(equations, np.eye(3)).matrices(t, x, end, np.inf)
    expected = np.einsum("rn,nrp->p", w, matrices[:, :, 12:])
    found = AdjointSteps(equations, np.eye(3)).by_parameters(t, x, end, w)
    assert np.abs(expected).min() > 1e-6
    np.testing.assert_allclose(found, expected, rtol=1e-11)
