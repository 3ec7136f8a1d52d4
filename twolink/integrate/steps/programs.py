"""The formulas of equations of motion as programs, each compared with Pinocchio or NumPy before its first use."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twolink.algorithms.tape import Tape
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected, traced_rate
from twolink.integrate.motion.scene_equations import structure_of
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import ITERATIONS, Method
from twolink.integrate.steps.step_certificate import certify_projection, certify_rate
from twolink.integrate.steps.step_formulas import semi_implicit_step
from twolink.native.differentiation import jacobian
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, assembled
from twolink.native.programs import arrays_named, keep, kept, once
from twolink.native.stepper import Formulas, Scheme, Stepper

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
        found = self._kept.get(method.name)
        if found is None:
            found = self._kept.setdefault(method.name, self._stepper(method))
        return found

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
