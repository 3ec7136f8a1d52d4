"""Forces: accelerations and what joints, loops and limits bear, of many states at once; compiled where that pays.

    M a + h = tau + B lambda + held

a: accelerations. lambda: the loops' multipliers. held: the torque of the lock on each lockable degree of freedom. The
formulas are written once: NumPy runs them, heyoka compiles them, and both are compared before compiled ones are used.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.namespaces import Expressions, Numbers
from twolink.dynamics import cache
from twolink.dynamics.kernels import heyoka
from twolink.errors import CertificationError
from twolink.integrate.compile_time import compiling_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import dynamics, lock_torques
from twolink.integrate.state import Array

PAYS = 2.0  # seconds of compiling, roughly, beyond which NumPy does
EVALUATIONS = 3  # that the formulas are worth: accelerations, torques, pushes
AGREEMENT = 1e-8  # relative
KEPT = 64


class Forces(NamedTuple):
    """Rows (.., n): a (nv), multipliers (kept rows), held (lockable), kinks (what passes 0), and loads (tau and h)."""

    a: Array
    multipliers: Array
    held: Array
    kinks: Array
    loads: Array


def forces(equations: Equations, t: Array, x: Array) -> Forces:
    """The forces of states x (size, n) at times t (n,)."""
    compiled = _compiled(equations)
    if compiled is None:
        return _by_numpy(equations, t, x)
    rows = np.ascontiguousarray(np.concatenate([np.broadcast_to(t, x.shape[1:])[None], x]))
    out = np.empty((sum(_sizes(equations)), x.shape[1]))
    compiled(rows, out)
    return _split(equations, out)


def _by_numpy(equations: Equations, t: Array, x: Array) -> Forces:
    with np.errstate(all="ignore"):
        found = _formulas(equations, equations.mechanism, t, x, Numbers)
    return _split(equations, np.array([np.broadcast_to(np.asarray(row, dtype=float), x.shape[1:]) for row in found]))


def _formulas(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Any]:
    solution = dynamics(equations, mech, t, x, xp)
    held, h = lock_torques(equations, mech, t, x, xp, solution)
    a, multipliers, loads = solution
    return [*a, *multipliers, *held, *(distance for _, distance in loads.limits), *loads.tau, *h]


def _sizes(equations: Equations) -> tuple[int, ...]:
    kept = 0 if equations.constraints is None else len(equations.constraints.kept)
    limits = len(equations.effort_limits)
    return equations.space.nv, kept, len(equations.layout.lockable), limits, 2 * equations.space.nv


def _split(equations: Equations, rows: Array) -> Forces:
    ends = np.cumsum(_sizes(equations))
    return Forces(*np.split(rows, ends[:-1]))


_kept: dict[str, Any] = {}
_lock = threading.Lock()


def _compiled(equations: Equations) -> Any:
    """heyoka's function of (t, x), or None where there is none or it would take long to compile."""
    if heyoka() is None or compiling_seconds(EVALUATIONS * equations.operations) > PAYS:
        return None
    name = equations.key("forces")
    with _lock:
        if name not in _kept:
            found = cache.load(name)
            _kept[name] = found if isinstance(found, heyoka().cfunc_dbl) else _build(name, equations)
            while len(_kept) > KEPT:
                del _kept[next(iter(_kept))]
        return _kept[name]


def _build(name: str, equations: Equations) -> Any:
    module = heyoka()
    xp = Expressions(module)
    rows = np.array([module.expression(f"x{i}") for i in range(1 + equations.space.size)], dtype=object)
    found = _formulas(equations, mechanism(equations.robot.model), rows[0], rows[1:], xp)
    compiled = module.cfunc([xp.lift(e) for e in found], vars=list(rows))
    state = equations.start[:, None]
    theirs = np.concatenate(_by_numpy(equations, np.zeros(1), state))
    ours = np.empty_like(theirs)
    compiled(np.concatenate([np.zeros((1, 1)), state]), ours)
    finite = np.isfinite(theirs)
    off = np.abs(ours - theirs)[finite].max(initial=0.0) / (1.0 + np.abs(theirs[finite]).max(initial=0.0))
    if not (off <= AGREEMENT and np.array_equal(finite, np.isfinite(ours))):
        raise CertificationError(f"compiled forces differ from NumPy's by {off:.1e}", where="events",
                                 remedy="report it with the URDF")  # fmt: skip
    cache.store(name, compiled)
    return compiled
