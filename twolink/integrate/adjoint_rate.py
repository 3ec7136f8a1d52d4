"""The rate of a state, and its derivatives pulled back along a covector, compiled: the right-hand side of an adjoint.

    x' = f(t, x, p),   (w^T df/dx, w^T df/dp)

The traced rate is run on `algorithms.reverse`: the derivatives by all parameters cost as much as those by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.namespaces import Expressions
from twolink.algorithms.reverse import Node, NodeNamespace
from twolink.dynamics.kernels import heyoka
from twolink.errors import CertificationError, MissingExtraError, SceneError
from twolink.integrate.compile_time import announced, compiling_seconds
from twolink.integrate.compiled_functions import compiled_function
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import traced_rate
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.state import Array
from twolink.integrate.variational_rate import (
    AGREEMENT,
    AROUND,
    STATES,
    STEP,
    constant_rows,
    side_count,
    sides_in_turn,
)

PULLED_BACK = 4.0  # times as many operations as the value


class AdjointRate(NamedTuple):
    """Compiled functions of rows (., n).

    value: of t, the numbers of the state behind (q, v), the parameters, the sides of limits of effort, and x = (q, v):
    the rates of x. pulled: of these rows and a covector w of x: w^T df/dx, then w^T df/dp by the numbers that are
    driven (the last of them) and by the parameters.
    """

    value: Callable[..., Any]
    pulled: Callable[..., Any]


def adjoint_rate(equations: Equations, driven: int) -> AdjointRate:
    """The compiled functions. driven: how many of the last numbers are derived by.

    Raises MissingExtraError without heyoka, and CertificationError where they disagree with Pinocchio.
    """
    if heyoka() is None:
        raise MissingExtraError("gradients need heyoka", remedy="pip install heyoka (Linux)")
    made: list[AdjointRate] = []

    def traced() -> AdjointRate:
        if not made:
            with announced(f"the adjoint of {equations.robot.name}",
                           compiling_seconds(equations.operations * (2.0 + PULLED_BACK))):  # fmt: skip
                made.append(_compiled(equations, driven))
                _certify(equations, made[0])
        return made[0]

    value, _ = compiled_function(equations.key("adjoint-value", str(driven)), lambda: traced().value)
    pulled, _ = compiled_function(equations.key("adjoint", str(driven)), lambda: traced().pulled)
    return AdjointRate(value, pulled)


def _compiled(equations: Equations, driven: int) -> AdjointRate:
    """heyoka's functions."""
    module, space, count = heyoka(), equations.space, len(equations.parameters)
    xp, moving = NodeNamespace(Expressions(module, own_sine=True)), equations.moving
    sizes = [1, space.size - moving, count, side_count(equations), moving, moving]
    rows = np.array([module.expression(f"x{i}") for i in range(sum(sizes))], dtype=object)
    (t,), numbers, values, sides, x, weights = np.split(rows, np.cumsum(sizes)[:-1])
    equations = replace(equations, sides=tuple(sides))
    constant = space.size - moving - driven
    inputs: list[Node] = [xp.node(a) for a in (*x, *numbers[constant:], *values)]
    whole = np.empty(space.size, dtype=object)
    whole[:] = [*inputs[:moving], *numbers[:constant], *inputs[moving : moving + driven]]
    constants = dict(zip(equations.parameters, inputs[moving + driven :], strict=True))
    try:
        out = traced_rate(equations, t, whole, xp, constants)[:moving]
    except TypeError as error:  # a number that is used as a constant
        raise SceneError(f"one of {', '.join(equations.parameters)} is used as a constant", argument="parameters",
                         remedy="leave it out", code="sensitivities-constant") from error  # fmt: skip
    bars = xp.pulled_back(list(out), list(weights), inputs)
    lift, own = xp.xp.lift, list(rows[: len(rows) - moving])
    return AdjointRate(module.cfunc([lift(entry.value) for entry in out], vars=own),
                       module.cfunc([lift(bar) for bar in bars], vars=list(rows)))  # fmt: skip


def _certify(equations: Equations, code: AdjointRate) -> None:
    """Compare w^T (df/dx) d with differences of Pinocchio's rates along directions d. Raises CertificationError."""
    equations = sides_in_turn(equations)
    space, moving = equations.space, equations.moving
    random = np.random.default_rng(1)
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    x[:moving, 1:] += random.uniform(-AROUND, AROUND, (moving, STATES - 1))
    along, weights = np.zeros((space.size, STATES)), random.uniform(-1.0, 1.0, (moving, STATES))
    along[:moving] = random.uniform(-1.0, 1.0, (moving, STATES))
    rows = np.concatenate([np.zeros((1, STATES)), np.repeat(constant_rows(equations), STATES, axis=1), x[:moving]])
    pulled = np.asarray(code.pulled(np.concatenate([rows, weights])))[:moving]

    def rate(k: int) -> Array:
        return np.asarray(rate_by_pinocchio(equations, 0.0, x + k * STEP * along)[:moving])

    theirs = (8.0 * (rate(1) - rate(-1)) - (rate(2) - rate(-2))) / (12.0 * STEP)
    own, size = np.asarray(code.value(rows)), 1.0 + np.nan_to_num(np.abs(theirs)).max(axis=0)
    errors = np.array([np.abs((pulled * along[:moving]).sum(axis=0) - (weights * theirs).sum(axis=0)),
                       np.abs(own - rate(0)).max(axis=0)])  # fmt: skip
    error = (errors / (size + np.nan_to_num(np.abs(own)).max(axis=0))).max(axis=0)
    if equations.constraints is not None or not np.isfinite(theirs).all():
        error[np.isnan(theirs).any(axis=0) & (np.arange(STATES) > 0)] = 0.0
    if not error.max() <= AGREEMENT:
        raise CertificationError(
            f"the compiled adjoint differs from Pinocchio's rates by {np.nanmax(error):.1e}",
            where=f"x = {x[:, int(np.argmax(error))].tolist()}",
            remedy="report it with the URDF",
        )
