"""The formulas of equations of motion as programs, each compared with Pinocchio or NumPy before its first use."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.tape import Tape
from twolink.errors import CertificationError
from twolink.integrate.motion.effect_numbers import nominal_vector
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected, traced_rate
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.scene_equations import structure_of
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import ITERATIONS, Method
from twolink.integrate.steps.step_formulas import semi_implicit_step
from twolink.native.differentiation import jacobian
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, assembled
from twolink.native.programs import arrays_named, keep, kept, once
from twolink.native.stepper import Formulas, Scheme, Stepper

AGREEMENT = 1e-8  # largest difference of the two steps, relative to the step
STATES = 8  # on which they are compared
BESIDE = 0.1  # rad, m, and per second: how far states are from the start
NEARER = (1.0, 0.1, 0.01, 0.0)  # of it: the first that is not much nearer to singular than the start
SINGULAR = 1e14  # condition numbers of mass matrices above it
ROUNDING = 1e-10  # rad, m, and per second: what a start may be off
LEAST = 0.1  # of the smallest pivot of the constraints at the start


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


@np.errstate(all="ignore")
def certify_rate(equations: Equations, compiled: Any) -> None:
    """Compare a rate of the moving rows with Pinocchio's at the start and around it, beside closed loops too.

    Solving for accelerations multiplies rounding by the condition number of the mass matrix, in both.
    """
    x, moving = _states(equations), equations.moving
    ours = compiled(np.concatenate([np.zeros((1, STATES)), x, _parameters(equations)]))[:moving]
    theirs = rate_by_pinocchio(equations, 0.0, x)[:moving]
    matrices = equations.robot.mass_matrix(equations.space.rows(x)[0])
    condition = np.linalg.cond(matrices) if matrices.size else np.ones(STATES)
    size = np.abs(theirs).max(axis=0) * (1.0 + np.finfo(float).eps * condition / AGREEMENT)
    size[condition > SINGULAR] = np.inf  # rounding decides there
    off = float(np.abs(ours[:, 0] - theirs[:, 0]).max())
    if off > AGREEMENT * (1.0 + size[0]) and _jump(equations, theirs[:, :1]) > 0.5 * off:
        size[0] = np.inf  # there too: bodies begin to touch along an edge, or to slide the other way
    _require_agreement(equations, "rate", x, ours, theirs, 1.0 + size)


def _jump(equations: Equations, rate: Array) -> float:
    """The largest change of Pinocchio's rate from that at the start to states that differ from it by a rounding."""
    shift = np.random.default_rng(2).uniform(-ROUNDING, ROUNDING, (equations.space.size, STATES))
    shift[equations.moving :] = 0.0
    x = equations.space.normalized(equations.start[:, None] + shift, Numbers)
    changed = rate_by_pinocchio(equations, 0.0, x)[: equations.moving]
    return float(np.nanmax(np.abs(changed - rate), initial=0.0))


def certify_projection(equations: Equations, compiled: Any) -> None:
    """Compare a projection of the moving rows with NumPy's."""
    x, moving = _states(equations), equations.moving
    with np.errstate(all="ignore"):
        theirs = projected(equations, x, Numbers)[:moving]
    scale = 1.0 + np.nan_to_num(np.abs(theirs)).max(axis=0)
    ours = compiled(np.concatenate([x, _parameters(equations)]))[:moving]
    _require_agreement(equations, "projection", x, ours, theirs, scale)


def _states(equations: Equations) -> Array:
    """The start, and random states BESIDE it, (size, STATES).

    Where constraints are nearly singular, such as where bodies overlap or at Painleve's angle of a rod that slides,
    nothing can be compared; states there are taken nearer to the start.
    """
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    shift = np.random.default_rng(1).uniform(-BESIDE, BESIDE, (equations.space.size, STATES))
    least, moved = LEAST * _smallest_pivots(equations, x[:, :1]), np.arange(1, STATES)
    for nearer in NEARER:
        x[:, moved] = equations.space.normalized(equations.start[:, None] + nearer * shift[:, moved], Numbers)
        moved = moved[~(_smallest_pivots(equations, x[:, moved]) >= least)]
    _lock_some(equations, x)
    return x


@np.errstate(all="ignore")
def _smallest_pivots(equations: Equations, x: Array) -> Array:
    """The smallest pivots (n,) of the constraints' A = J M^-1 B of states, scaled; NaN where they are not finite.

    Infinite without rows: what a stop holds already leaves those of a contact none.
    """
    constraints, space = equations.constraints, equations.space
    if constraints is None or not (constraints.kept and x.size):
        return np.full(x.shape[1], np.inf)
    q, v = x[: space.nq], x[space.v_rows]
    rows = constraints.jacobian(constraints.mech, q, Numbers)
    loops = equations.layout.with_numbers(constraints.loops, list(x[space.moving :]))
    forces = constraints.force_rows(constraints.mech, q, v, Numbers, rows, loops)
    jacobian, pushed = (np.array([[np.broadcast_to(entry, x.shape[1:]) for entry in row] for row in matrix], float)
                        for matrix in (rows, forces))  # fmt: skip
    moved = np.linalg.solve(equations.robot.mass_matrix(space.rows(x)[0]), pushed.transpose(2, 1, 0))
    matrix = jacobian.transpose(2, 0, 1) @ moved * np.outer(constraints.scales, constraints.scales)
    minors = np.array([np.linalg.det(matrix[:, :k, :k]) for k in range(len(rows) + 1)])
    return np.asarray((minors[1:] / minors[:-1]).min(axis=0))


def _parameters(equations: Equations) -> Array:
    """The robot's own values of the run-time parameters, (p, STATES)."""
    return np.repeat(nominal_vector(equations)[:, None], STATES, axis=1)


def _require_agreement(equations: Equations, what: str, x: Array, ours: Array, theirs: Array, scale: Array) -> None:
    """Require that results (moving, STATES) agree. Raises CertificationError with the worst state."""
    with np.errstate(all="ignore"):
        error = np.abs(ours - theirs).max(axis=0) / scale
    # Where the motion has no rate, or rounding decides about it, there is nothing to compare: the solver says so.
    error[~(np.isfinite(theirs).all(axis=0) & np.isfinite(scale))] = 0.0
    if equations.constraints is not None:  # beside a singular position there is no number: that is meant
        error[np.isnan(ours).any(axis=0) & (np.arange(STATES) > 0)] = 0.0
    if not error.max() <= AGREEMENT:
        worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        raise CertificationError(
            f"the {what} differs from Pinocchio's by {error[worst]:.1e}",
            where=f"x = {x[:, worst].tolist()}",
            remedy="report it with the URDF",
        )


Columns = Callable[[Any, Array], Array]  # (t, x) -> x' of columns


class Programs:
    """The programs of equations. Numbers of the scene are inputs where other scenes share the formula.

    equations: whose formulas are traced. values: of its parameters, where these are not rows of the state array.
    """

    def __init__(self, equations: Equations) -> None:
        self.own, self.equations, self.values = equations, equations, None
        if equations.numbers_as_inputs and not equations.parameters:
            self.equations, self.values = structure_of(equations)
        self._kept: dict[str, Stepper] = {}

    def _program(self, kind: str, trace: Callable[[], Assembled]) -> Program:
        return Program(arrays_named(self.equations.key(kind), trace), self.values)

    @functools.cached_property
    def rate(self) -> Program:
        """(t, x, p) -> x' of the moving rows."""
        size, moving = self.equations.space.size, self.equations.moving

        def trace() -> Assembled:
            tape, z, constants = self._inputs(1)
            return assembled(tape, z, traced_rate(self.equations, z[0], z[1 : 1 + size], tape, constants)[:moving])

        program = self._program("rate", trace)
        once(self.own.key("rate", "certified"), lambda: certify_rate(self.own, program))
        return program

    @functools.cached_property
    def projection(self) -> Program | None:
        """(x, p) -> the moving rows of x on its manifold; None where all of the space is."""
        equations = self.equations
        if equations.constraints is None and not equations.space.curved:
            return None

        def trace() -> Assembled:
            tape, z, constants = self._inputs(0)
            size = equations.space.size
            return assembled(tape, z, projected(equations, z[:size], tape, constants)[: equations.moving])

        program = self._program("projection", trace)
        if equations.constraints is not None:
            once(self.own.key("projection", "certified"), lambda: certify_projection(self.own, program))
        return program

    def jacobian(self) -> tuple[Program, Array]:
        """(t, x, p) -> entries of dx'/dx, and their rows and columns (k, 2)."""
        size, moving = self.equations.space.size, self.equations.moving
        tape, z, constants = self._inputs(1)
        rates = list(traced_rate(self.equations, z[0], z[1 : 1 + size], tape, constants)[:moving])
        places, values = jacobian(tape, rates, z[1 : 1 + moving])
        program = self._program("jacobian", lambda: assembled(tape, z, values))
        return program, np.array(places, dtype=np.int32).reshape(-1, 2)

    def semi_implicit(self) -> Program:
        """(t, x, p, h) -> the moving rows after a step of the semi-implicit Euler method."""
        size, moving = self.equations.space.size, self.equations.moving

        def trace() -> Assembled:
            tape, z, constants = self._inputs(1)
            h = tape.variable()

            def rate(t: Any, x: Array) -> Array:
                return traced_rate(self.equations, t, x, tape, constants)

            new = semi_implicit_step(self.equations.space, rate, z[0], z[1 : 1 + size], h)[0]
            return assembled(tape, [*z, h], list(new[:moving]))

        return self._program("semi-implicit", trace)

    def stepper(self, method: Method) -> Stepper:
        """A method on these programs in the native library."""
        return self._kept.get(method.name) or self._kept.setdefault(method.name, self._stepper(method))

    def _stepper(self, method: Method) -> Stepper:
        whole, entries, slope = method.tableau is None, np.zeros((0, 2)), None
        rate = self.semi_implicit() if whole else self.rate
        if method.kind == "implicit":
            slope, entries = self.jacobian()
        space, joints = self.own.space, [(q.start, q.stop, v.start, v.stop) for q, v in self.own.space.joint_rows]
        formulas = Formulas(
            rate, self.projection, slope, space.size, space.moving, 0 if self.values is not None else
            len(self.equations.parameters), space.absolute[: space.moving], np.array(joints).reshape(-1, 4), entries,
        )  # fmt: skip
        return Stepper(formulas, scheme_of(method))

    def columns(self, parameters: Array | None = None) -> tuple[Columns, Callable[[Array], Array]]:
        """(rate of columns (t, x), projection of columns x), for steps by NumPy. parameters: (p, n)."""
        rate, project, rest = self.rate, self.projection, self.own.space.size - self.own.moving
        extra = np.zeros((0, 1)) if parameters is None else parameters

        def rows(x: Array, *first: Any) -> Array:
            width = x.shape[1]
            tiled = np.tile(extra, (1, -(-width // extra.shape[1])))[:, :width]
            return np.concatenate([*(np.broadcast_to(t, (1, width)) for t in first), x, tiled])

        def evaluated(t: Any, x: Array) -> Array:
            return np.concatenate([rate(rows(x, t)), np.zeros((rest, x.shape[1]))])  # which do not move

        def on_manifold(x: Array) -> Array:
            return x if project is None else np.concatenate([project(rows(x)), x[self.own.moving :]])

        return evaluated, on_manifold

    def _inputs(self, before: int) -> tuple[Tape, Array, Mapping[str, Any]]:
        """A tape, its inputs, so many before x, and the parameters among them by name."""
        tape, size = Tape(), self.equations.space.size
        z = tape.variables(before + size + len(self.equations.parameters))
        return tape, z, dict(zip(self.equations.parameters, z[before + size :], strict=True))


def programs_of(equations: Equations) -> Programs:
    """The programs of equations, kept in the process by what they depend on: not by the start."""
    name = equations.key("numbers" if equations.numbers_as_inputs else "programs")
    found: Programs | None = kept(name)
    return keep(name, Programs(equations)) if found is None else found


def scheme_of(method: Method) -> Scheme:
    """A method as the arrays that the native library takes."""
    tableau = method.tableau
    if tableau is None:
        empty = np.zeros(0)
        return Scheme("whole", False, empty.reshape(0, 0), empty, empty, empty, 1)
    stages = len(tableau.b)
    a = np.zeros((stages, stages))
    for row, values in zip(a, tableau.a, strict=True):
        row[: len(values)] = values
    return Scheme(method.kind, method.adaptive, a, np.array(tableau.b), np.array(tableau.c),
                  np.array(tableau.errors).reshape(-1, stages), method.error_order, ITERATIONS)  # fmt: skip
