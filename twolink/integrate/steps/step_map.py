"""The step map: a method on a scene's equations as a function state -> state, for any number of worlds.

A state array (rows, n) has the rows of x, then those of `step_control.Control`, then the run-time parameters.

The native library makes the attempts on programs that are compared with Pinocchio before their first use; without it
NumPy does, by the same formulas. A world has the same bits alone and in any batch. A map called with an infinite
tolerance and an end within a step takes exactly that part of the step: samples and events are computed so, with the
order of the method.
"""

from collections.abc import Callable

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.errors import TwolinkError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Code
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.numeric_steps import Formulas, Map, numeric_map
from twolink.integrate.steps.programs import programs_of
from twolink.integrate.steps.step_control import Control, control_rows
from twolink.native.library import library
from twolink.native.stepper import Disturbances, Stepper
from twolink.native.ticks import TickedLaw, Ticks

SHARES = (0.5, 0.3, 0.7)  # of a step, at which two steps in its place meet
SPREADS = (1 / 256, 1 / 64, 1 / 16, 1 / 4)  # of a step: distances of the states between which one is interpolated


class StepMap:
    """A method on equations. Calling it attempts one step of each world and writes the states into `out`.

    rows: the indices of the control's rows. by: the native stepper, or NumPy's map. columns: parameters -> the rate
    and the projection of columns. compile_seconds: what tracing, loading and comparing the programs took, 0 where they
    were at hand.
    """

    def __init__(
        self, equations: Equations, method: Method, by: Stepper | Map, columns: Formulas, compile_seconds: float = 0.0
    ) -> None:
        self.equations, self.method, self.compile_seconds = equations, method, compile_seconds
        self._native: Stepper | None = by if isinstance(by, Stepper) else None
        self._map: Map | None = None if isinstance(by, Stepper) else by
        self._columns = columns
        self.rows: Control = control_rows(equations.space.size)

    @property
    def compiled(self) -> Code:
        """ "steps" where the native library makes them; else ""."""
        return "steps" if self._native is not None else ""

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        if self._map is not None:
            self._map(state, out, None)
        else:
            states = np.empty((2, *state.shape))
            states[0] = state
            self.attempts(states, 1, 1)
            out[:] = states[1]

    def on(self, states: Array, disturbances: Disturbances | None = None) -> Callable[[int, int], int]:
        """`attempts` on states (most + 1, rows, n) that stay where they are: (count, look) -> how many were made."""
        if self._native is not None:
            return self._native.on(states, disturbances)
        return lambda count, look: self.attempts(states[: count + 1], count, look, disturbances)

    def ticks(self, columns: int, law: TickedLaw, disturbances: Disturbances | None) -> Ticks | None:
        """The steps of columns with the ticks of a law between them; None where the library does not make them."""
        if self._native is None or not (law.program is None or law.program.fits(self._native.width(columns))):
            return None
        return Ticks(self._native, columns, law, disturbances)

    def attempts(self, states: Array, count: int, look: int, disturbances: Disturbances | None = None) -> int:
        """Up to `count` attempts of each world of states (count + 1, rows, n), of which the first is given.

        Returns how many were made: fewer when all worlds have arrived, or, every `look` attempts, half of them.
        disturbances: added to worlds that have not arrived, before each attempt.
        """
        if self._native is not None:
            return self._native.attempts(states, count, look, disturbances)
        if self._map is None:
            raise TwolinkError("there are no steps", code="native-library")
        time, end = self.rows.time, self.rows.end
        for k in range(count):
            now = states[k]
            if disturbances is not None:
                now, x = now.copy(), now[: self.equations.moving]
                tried = (now[self.rows.accepted] + now[self.rows.rejected]).astype(int)
                now[: len(x)] += np.where(now[time] < now[end], disturbances.added(tried, x), 0.0)
            self._map(now, states[k + 1], None if disturbances is None else disturbances.embedded)
            going = np.count_nonzero(states[k + 1, time] < states[k + 1, end])
            if going == 0 or ((k + 1) % look == 0 and 2 * going < now.shape[1]):
                return k + 1
        return count

    def rate(self, t: Array | float, x: Array, parameters: Array | None = None) -> Array:
        """x' of the moving rows (moving, n) of states x (size, n) at one time or a time each."""
        with np.errstate(all="ignore"):
            none = np.zeros((0, 1))
            rate, _ = self._columns(none if parameters is None else parameters)
            return np.asarray(rate(t, x)[: self.equations.moving])

    def partial(self, x: Array, start: Array | float, end: Array, parameters: Array | None = None) -> Array:
        """States (size, n) at the times `end` (n,), each by one step from x (size, n or 1) at `start` (n,) or one time.

        The step gives no number where a stage meets a singular instant: then two steps are taken. Where the end itself
        is at one, the state is interpolated between four around it.
        """
        out = self._one_step(x, start, end, parameters)
        if np.count_nonzero(np.isfinite(out)) == out.size:  # takes half the time of `all`
            return out
        x, start = np.broadcast_to(x, out.shape), np.broadcast_to(start, end.shape)
        out = self._one_or_two_steps(x, start, end, parameters)
        for spread in SPREADS:
            late = ~np.isfinite(out).all(axis=0)
            if not late.any():
                break
            h, values = spread * (end - start)[late], None if parameters is None else parameters[:, late]
            before, near_before, near_after, after = (
                self._one_or_two_steps(x[:, late], start[late], end[late] + k * h, values) for k in (-2, -1, 1, 2)
            )
            out[:, late] = (4.0 * (near_before + near_after) - (before + after)) / 6.0  # its error is O(h^4)
        return out

    def _one_or_two_steps(self, x: Array, start: Array, end: Array, parameters: Array | None) -> Array:
        """States by one step each, or by two where that gives no number."""
        out = self._one_step(x, start, end, parameters)
        for share in SHARES:
            late = ~np.isfinite(out).all(axis=0)
            if not late.any():
                break
            begin, stop, values = start[late], end[late], None if parameters is None else parameters[:, late]
            middle = begin + share * (stop - begin)
            out[:, late] = self._one_step(self._one_step(x[:, late], begin, middle, values), middle, stop, values)
        return out

    def _one_step(self, x: Array, start: Array | float, end: Array, parameters: Array | None) -> Array:
        """States (size, n) by one step each; NaN for a world that has not arrived."""
        size, count = len(x), len(end)
        extra, rows = 0 if parameters is None else len(parameters), self.rows
        states = np.zeros((2, size + len(rows) + extra, count))
        worlds = states[0]
        worlds[:size], worlds[rows.time], worlds[rows.end] = x, start, end
        worlds[rows.step] = worlds[rows.tolerance] = worlds[rows.longest] = np.inf
        worlds[rows.good] = worlds[rows.previous] = 1.0  # any number: of the control, which has no say here
        if extra:
            worlds[-extra:] = parameters
        self.attempts(states, 1, 1)
        new: Array = states[1, :size]
        late = states[1, rows.time] < end
        if np.count_nonzero(late):
            new[:, late] = np.nan
        return new


def step_map(equations: Equations, method: Method, *, portable: bool = False) -> StepMap:
    """The step map of a method.

    portable: on Pinocchio's rates, state by state, which programs are held against; run-time parameters are the robot's
    own there. Raises CertificationError when a program disagrees with Pinocchio.
    """
    if portable:

        def formulas(_: Array):  # type: ignore[no-untyped-def]
            return (lambda t, x: rate_by_pinocchio(equations, t, x)), lambda x: projected(equations, x, Numbers)

        return StepMap(equations, method, numeric_map(equations, method, formulas), formulas)
    programs = programs_of(equations)
    seconds = programs.seconds
    by: Stepper | Map
    by = numeric_map(equations, method, programs.columns) if library() is None else programs.stepper(method)
    return StepMap(equations, method, by, programs.columns, programs.seconds - seconds)
