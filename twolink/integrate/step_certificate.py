"""The certificate of a compiled step: it agrees with the portable one on Pinocchio's rates."""

from collections.abc import Callable

import numpy as np

from twolink.algorithms.mechanism import nominal
from twolink.algorithms.namespaces import Numbers
from twolink.errors import CertificationError, SceneError
from twolink.integrate.assembly import assembled
from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.state import Array
from twolink.integrate.step_control import initial_state
from twolink.integrate.stiffness import fastest

AGREEMENT = 1e-8  # largest difference of the two steps, relative to the step
STATES = 8  # on which they are compared
Map = Callable[[Array, Array], None]


def _on_manifold(equations: Equations, x: Array) -> Array:
    """States (size, n) with unit lengths and closed loops; the start where a loop cannot be closed."""
    x = equations.space.normalized(x, Numbers)
    if equations.constraints is None:
        return x
    moving = equations.moving
    for column in range(x.shape[1]):
        try:
            x[:moving, column] = assembled(equations.constraints, x[:moving, column])
        except SceneError:
            x[:, column] = equations.start
    return x


def _lock_some(equations: Equations, x: Array) -> None:
    """Lock some joints in each state but the first, as far as the loops leave the others free to move."""
    lockable, constraints = equations.layout.lockable, equations.constraints
    first = equations.space.size - 2 * len(lockable)
    x[first : first + len(lockable)] = 0.0
    for column in range(1, x.shape[1]):
        locks = x[first : first + len(lockable), column]
        for i in range(column % 2, len(lockable), 2):
            if constraints is not None:
                jacobian = constraints.jacobian_at(x[: equations.space.nq, column], constraints.kept)
                jacobian[:, list(lockable)] *= 1.0 - np.where(np.arange(len(lockable)) == i, 1.0, locks)
                if np.linalg.matrix_rank(jacobian, tol=1e-3) < len(jacobian):
                    continue
            locks[i] = 1.0


def certify(equations: Equations, method: Method, portable: Map, compiled: Map) -> None:
    """Compare one step of both maps, from the start and from random states around it.

    Raises CertificationError with the worst state.
    """
    size = equations.space.size
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    x[:, 1:] += np.random.default_rng(1).uniform(-1, 1, (size, STATES - 1))
    x = _on_manifold(equations, x)
    _lock_some(equations, x)
    change = np.abs(rate_by_pinocchio(equations, 0.0, x)).max(axis=0, initial=0.0)
    h = 0.05 / (1.0 + np.maximum(change, fastest(equations, x)[0]))
    values = [nominal(equations.robot.model, name) for name in equations.parameters]
    state = initial_state(x, 0.0, h, h, np.inf, parameters=np.array(values)[:, None] if values else None)
    ours, theirs = np.empty_like(state), np.empty_like(state)
    compiled(state, ours)
    portable(state, theirs)
    scale = 1.0 + np.abs(x).max(axis=0) + np.abs(theirs[:size] - x).max(axis=0)
    error = np.abs(ours[:size] - theirs[:size]).max(axis=0) / scale
    if equations.constraints is not None:  # a compiled step gives no number beside a singular position: that is meant
        error[np.isnan(ours[:size]).any(axis=0) & (np.arange(STATES) > 0)] = 0.0
    if not error.max() <= AGREEMENT:
        worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        raise CertificationError(
            f"the compiled step of {method.name} differs from Pinocchio's by {error[worst]:.1e}",
            where=f"x = {x[:, worst].tolist()}, h = {h[worst]:.3g}",
            remedy='report it with the URDF; method="scipy-dop853" does without compiled steps',
        )
