"""Formulas of the equations of motion, over plain arithmetic: NumPy evaluates them, the machine runs their tape.

    M a + h = tau + B lambda + lock torques

tau: effects and dry friction. B lambda: constraints. A locked degree of freedom has a = 0.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.factors import ldlt_solve
from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.recursions import composite_bodies, newton_euler, poses
from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.effects import Effect
from twolink.effects.effect import Loads
from twolink.integrate.motion.constraints import locked_matrix
from twolink.integrate.motion.effect_numbers import physical, with_effect_numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array


class Dynamics(NamedTuple):
    """a (nv), the multipliers of the kept constraint rows, and the loads that act."""

    a: list[Scalar]
    multipliers: list[Scalar]
    loads: Loads


def motion_of(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> KinematicState:
    """The moving robot at a state x (size, ...)."""
    space = equations.space
    states = dict(zip(space.states, x[space.z_rows], strict=True))
    return KinematicState(equations.robot.model, mech, list(x[: space.nq]), list(x[space.v_rows]), t, xp, states)


def effect_loads(
    equations: Equations, motion: KinematicState, numbers: Sequence[Any], effects: Sequence[Effect]
) -> Loads:
    """Torques and wrenches of these effects. numbers: the rows of the state behind (q, v, z)."""
    loads = Loads(motion, equations.sides)
    for effect in equations.layout.with_numbers(effects, numbers):
        effect.act(motion, loads)
    return loads


def loaded(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> tuple[KinematicState, Loads]:
    """The moving robot at a state x (size, ...), and the torques and wrenches of all effects on it."""
    motion = motion_of(equations, mech, t, x, xp)
    return motion, effect_loads(equations, motion, list(x[equations.moving :]), equations.effects)


def dynamics(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> Dynamics:
    """Accelerations and constraint forces under constraints and locks."""
    layout, numbers = equations.layout, list(x[equations.moving :])
    motion, loads = loaded(equations, mech, t, x, xp)
    for k, torque in layout.friction(numbers):
        loads.torque(k, torque)
    free = layout.free(numbers)
    constraints = equations.constraints
    if constraints is not None:
        # Rows of curved joints are taken as arrays, of a batch too.
        state = x if isinstance(x, np.ndarray) else _objects(x)
        loops = layout.with_numbers(constraints.loops, numbers)
        robot = state[: equations.space.v_rows.stop]
        a, multipliers = constraints.accelerations(mech, robot, loads.tau, loads.wrenches, xp, free, loops)
        return Dynamics(a, multipliers, loads)
    at = poses(mech, motion.q, xp)
    h = newton_euler(mech, at, motion.v, [0.0] * mech.nv, loads.wrenches)
    mass = locked_matrix(composite_bodies(mech, at), free)
    right = [times(f, minus(tau, bias)) for f, tau, bias in zip(free, loads.tau, h, strict=True)]
    return Dynamics(ldlt_solve(mass, mech.dof_parents(), right, xp), [], loads)


def accelerations(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Scalar]:
    """(a, z') of a state x (size,), by the formula of a with the fewest operations."""
    if equations.constraints is not None or equations.layout.lockable:
        solution = dynamics(equations, mech, t, x, xp)
        return [*solution.a, *state_rates(equations, solution.loads)]
    motion, loads = loaded(equations, mech, t, x, xp)
    arguments = {"q": motion.q, "v": motion.v, "tau": loads.tau, "f_ext": loads.wrenches}
    a = function(equations.robot.model, "forward_dynamics").variants[equations.variant](mech, arguments, xp)
    return [*a, *state_rates(equations, loads)]


def state_rates(equations: Equations, loads: Loads) -> list[Scalar]:
    """z' of the states of effects; 0 while an effect does not act."""
    return [loads.rates.get(name, 0.0) for name in equations.space.states]


def unbalanced_forces(equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Scalar]:
    """M a = tau - h (nv) of a state x (size,): what accelerates the robot, without constraints, friction and locks."""
    motion, loads = loaded(equations, mech, t, x, xp)
    h = newton_euler(mech, poses(mech, motion.q, xp), motion.v, [0.0] * mech.nv, loads.wrenches)
    return [minus(tau, bias) for tau, bias in zip(loads.tau, h, strict=True)]


def lock_torques(
    equations: Equations, mech: Mechanism, t: Any, x: Any, xp: Any, solution: Dynamics
) -> tuple[list[Scalar], list[Scalar]]:
    """(torque of the lock on each lockable degree of freedom, h (nv)): what remains of M a + h - tau - B lambda."""
    motion = motion_of(equations, mech, t, x, xp)
    at, loads = poses(mech, motion.q, xp), solution.loads
    h = newton_euler(mech, at, motion.v, [0.0] * mech.nv, loads.wrenches)
    if not equations.layout.lockable:
        return [], h
    needed = newton_euler(mech, at, motion.v, solution.a, loads.wrenches)
    rows = constraint_forces(equations, mech, x, xp)
    torques = []
    for k in equations.layout.lockable:
        constraint = plus(*(times(row[k], size) for row, size in zip(rows, solution.multipliers, strict=True)))
        torques.append(minus(minus(needed[k], loads.tau[k]), constraint))
    return torques, h


def constraint_forces(equations: Equations, mech: Mechanism, x: Array, xp: Any) -> list[list[Scalar]]:
    """B^T: the generalized force of each kept constraint row's multiplier of size 1."""
    constraints = equations.constraints
    if constraints is None:
        return []
    q, v = x[: equations.space.nq], x[equations.space.v_rows]
    loops = equations.layout.with_numbers(constraints.loops, list(x[equations.moving :]))
    return constraints.force_rows(mech, q, v, xp, constraints.jacobian(mech, q, xp), loops)


def traced_rate(equations: Equations, t: Any, x: Array, xp: Any, constants: Mapping[str, Any] | None = None) -> Array:
    """x' (size,) as expressions of x (size,), traced over the robot's constants."""
    space, values = equations.space, constants or {}
    equations = with_effect_numbers(equations, values)
    # Stages stray from unit lengths: there the acceleration is that of the nearest configuration, as by Pinocchio.
    unit = space.normalized(x, xp)
    rates = accelerations(equations, mechanism(equations.robot.model, physical(values)), t, unit, xp)
    constant = [0.0] * (space.size - space.moving)
    lifted = np.array([xp.lift(value) for value in (*rates, *constant)], dtype=object)
    return np.concatenate([space.rate(x[: space.nq], x[space.v_rows]), lifted])


def projected(equations: Equations, x: Array, xp: Any, constants: Mapping[str, Any] | None = None) -> Array:
    """x (size, ...) back on its manifold: unit lengths, and constraints fulfilled."""
    x = equations.space.normalized(x, xp)
    if equations.constraints is None:
        return x
    mech = equations.mechanism if xp is Numbers else mechanism(equations.robot.model, physical(constants or {}))
    robot = equations.space.v_rows.stop
    free = equations.layout.free(list(x[equations.moving :]))
    return np.concatenate([equations.constraints.projected(mech, x[:robot], xp, free), x[robot:]])


def _objects(values: list[Any]) -> Array:
    """Scalars of any kind as an array."""
    out = np.empty(len(values), dtype=object)
    out[:] = values
    return out
