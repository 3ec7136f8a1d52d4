"""The step map: a method on a scene's equations as a function state -> state, for any number of worlds.

A state array (rows, n) has the rows of x, then those of `step_control.Control`, then the run-time parameters.

The native library makes the attempts on programs that are compared with Pinocchio before their first use; without it
NumPy does, by the same formulas. A world has the same bits alone and in any batch. A map called with an infinite
tolerance and an end within a step takes exactly that part of the step: samples and events are computed so, with the
order of the method.
"""

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Code
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.programs import programs_of
from twolink.integrate.steps.step_control import Control, control_rows
from twolink.integrate.steps.step_formulas import Formulas, NumericSteps
from twolink.native.library import library
from twolink.native.stepper import Disturbances, Stepper
from twolink.native.ticks import TickedLaw, Ticks

SHARES = (0.5, 0.3, 0.7)  # of a step, at which two steps in its place meet
SPREADS = (1 / 256, 1 / 64, 1 / 16, 1 / 4)  # of a step: distances of the states between which one is interpolated


class StepMap:
    """A method on equations.

    rows: the indices of the control's rows. by: what makes the attempts; `attempts` and `on` are its own. columns:
    parameters -> the rate and the projection of columns.
    """

    def __init__(self, equations: Equations, method: Method, by: Stepper | NumericSteps, columns: Formulas) -> None:
        self.equations, self.method, self._by, self._columns = equations, method, by, columns
        self.attempts, self.on = by.attempts, by.on
        self.rows: Control = control_rows(equations.space.size)

    @property
    def compiled(self) -> Code:
        """ "steps" where the native library makes them; else ""."""
        return "steps" if isinstance(self._by, Stepper) else ""

    def ticks(self, columns: int, law: TickedLaw, disturbances: Disturbances | None) -> Ticks | None:
        """The steps of columns with the ticks of a law between them; None where the library does not make them."""
        by = self._by
        if not isinstance(by, Stepper) or not (law.program is None or law.program.fits(by.width(columns))):
            return None
        return Ticks(by, columns, law, disturbances)

    def rate(self, t: Array | float, x: Array, parameters: Array | None = None) -> Array:
        """x' of the moving rows (moving, n) of states x (size, n) at one time or a time each."""
        with np.errstate(all="ignore"):
            rate, _ = self._columns(parameters)
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

        def formulas(_: Array | None):  # type: ignore[no-untyped-def]
            return (lambda t, x: rate_by_pinocchio(equations, t, x)), lambda x: projected(equations, x, Numbers)

        return StepMap(equations, method, NumericSteps(equations, method, formulas), formulas)
    programs = programs_of(equations)
    native = library() is not None
    by = programs.stepper(method) if native else NumericSteps(equations, method, programs.columns)
    return StepMap(equations, method, by, programs.columns)
