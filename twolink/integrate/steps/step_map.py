"""The step map: a method on a scene's equations as one function state -> state, for any number of worlds.

A state array (rows, n) has the rows of x, then those of `step_control.Control`, then the run-time parameters.

The portable map runs on Pinocchio's rates. The compiled one is a single heyoka function of the same text. Where that
would take long to compile, the rate and the projection are compiled alone, for good or for the first steps. What is
compiled is compared with Pinocchio before it is first used. A map called with an infinite tolerance and an end within a
step takes exactly that part of the step: samples and events are computed so, with the order of the method.
"""

import functools
from typing import Any

import numpy as np

from twolink.dynamics.kernels import heyoka, pays_threads
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import structure_of
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Code
from twolink.integrate.steps.chain import longest_chain
from twolink.integrate.steps.compile_time import (
    FOR_ANY_NUMBERS,
    MAX_IN_PARTS,
    UNOPTIMIZED,
    FirstSteps,
    announced,
    first_steps_pay,
    in_parts,
    is_reproducible,
    parts_seconds,
    step_seconds,
)
from twolink.integrate.steps.compiled_functions import compiled_function, is_at_hand, once
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.step_building import (
    Map,
    compiled_map,
    compiled_projection,
    compiled_rate,
    map_in_parts,
    portable_map,
)
from twolink.integrate.steps.step_certificate import certify, certify_projection, certify_rate
from twolink.integrate.steps.step_control import Control, control_rows

LANES = 8  # batches are padded to whole vectors, so that every world gets the same bits wherever it stands
SHARES = (0.5, 0.3, 0.7)  # of a step, at which two steps in its place meet
SPREADS = (1 / 256, 1 / 64, 1 / 16, 1 / 4)  # of a step: distances of the states between which one is interpolated


class StepMap:
    """A method on equations. Calling it attempts one step of each world and writes the states into `out`.

    rows: the indices of the control's rows. compiled: "steps" where whole steps are heyoka's; "parts" where the rate
    and the projection are, perhaps until whole steps pay; else "". compile_seconds: what compiling or loading took, 0
    where it was at hand.
    """

    def __init__(self, equations: Equations, method: Method, call: Map, compiled: Code, compile_seconds: float) -> None:
        self.equations = equations
        self.method = method
        self.compiled = compiled
        self.compile_seconds = compile_seconds
        self._call = call
        self.rows: Control = control_rows(equations.space.size)

    def call(self, worlds: int) -> Map:
        """The function that attempts one step of each of so many worlds: on threads where that pays.

        heyoka's own choice takes threads from a few dozen worlds on, which is slower and keeps a second core busy.
        """
        if isinstance(self._call, FirstSteps) and self._call.used_up:
            self._call, self.compiled, seconds = _better(self.equations, self.method)
            self.compile_seconds += seconds
        # Naming the option takes 0.5 µs, a quarter of a small step.
        if worlds == 1 or not self.compiled or isinstance(self._call, FirstSteps):
            return self._call
        return functools.partial(self._call, batch_parallel=self._on_threads(worlds))

    def steps_at_once(self, worlds: int) -> int:
        """How many steps of so many worlds one call can make, by `chain.take_steps`."""
        if self.compiled != "steps" or (worlds > 1 and self._on_threads(worlds)):
            return 1
        return longest_chain(worlds, self._vector)

    @property
    def _vector(self) -> int:
        """How many worlds fill a vector of compiled code."""
        return getattr(self._call, "batch_size", LANES)

    def padded(self, worlds: int) -> int:
        """So many worlds or more, which a call takes no longer for than for fewer."""
        return worlds + (-worlds % self._vector if self.compiled and worlds > 1 else 0)

    def _on_threads(self, worlds: int) -> bool:
        """Whether a call with so many worlds pays threads."""
        return pays_threads(worlds, self.equations.operations * self.method.evaluations)

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        self.call(state.shape[1])(state, out)

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
        width = -(-count // LANES) * LANES if self.compiled else count
        extra = 0 if parameters is None else len(parameters)
        state = np.zeros((size + len(self.rows) + extra, width))  # zeros: worlds that have arrived
        worlds, rows = state[:, :count], self.rows
        worlds[:size], worlds[rows.time], worlds[rows.end] = x, start, end
        worlds[rows.step] = worlds[rows.tolerance] = worlds[rows.longest] = np.inf
        worlds[rows.good] = worlds[rows.previous] = 1.0  # any number: of the control, which has no say here
        if extra:
            worlds[-extra:] = parameters
        out = np.empty_like(state)
        self(state, out)
        new = out[:size, :count].copy()
        late = out[rows.time, :count] < end
        if np.count_nonzero(late):
            new[:, late] = np.nan
        return new


def step_map(equations: Equations, method: Method, *, portable: bool = False, whole: bool = False) -> StepMap:
    """The step map of a method, compiled where heyoka is installed; kept for the life of the process.

    whole: whole steps are compiled before the first one, where that does not take too long. Raises CertificationError
    when what is compiled disagrees with Pinocchio's.
    """
    parts = in_parts(equations, method)
    if portable or heyoka() is None or (parts and parts_seconds(equations) > MAX_IN_PARTS):
        return StepMap(equations, method, portable_map(equations, method), "", 0.0)
    if equations.numbers_as_inputs and not equations.parameters:
        call, seconds = _for_any_numbers(equations, method)
        return StepMap(equations, method, call, "parts", seconds)
    name = equations.key("rate", "whole") if parts else _name(equations, method)
    if not (whole or is_reproducible() or is_at_hand(name)) and first_steps_pay(equations, method, name):
        call, seconds = _in_parts(equations, method, first=True)
        return StepMap(equations, method, FirstSteps(equations, method, name, call), "parts", seconds)
    return StepMap(equations, method, *_better(equations, method))


def _name(equations: Equations, method: Method) -> str:
    """The name of whole compiled steps."""
    return equations.key("step", method.name)


def _better(equations: Equations, method: Method) -> tuple[Map, Code, float]:
    """Whole compiled steps, or optimized parts where those take too long, and the seconds of compiling or loading."""
    if in_parts(equations, method):
        call, seconds = _in_parts(equations, method, first=False)
        return call, "parts", seconds
    call, seconds = _whole(equations, method)
    return call, "steps", seconds


def _whole(equations: Equations, method: Method) -> tuple[Map, float]:
    """Whole compiled steps, and the seconds of compiling or loading them."""
    return compiled_function(_name(equations, method), lambda: _compiled(equations, method))


def _for_any_numbers(equations: Equations, method: Method) -> tuple[Map, float]:
    """Steps by code that other numbers share: whole ones where that compiles soon. And the seconds of compiling."""
    if step_seconds(equations, method) > FOR_ANY_NUMBERS:
        return _in_parts(equations, method, first=True)
    base, values = structure_of(equations)
    code, seconds = _whole(base, method)

    def call(state: Array, out: Array, *, batch_parallel: bool = False) -> None:
        rows = np.concatenate([state, np.broadcast_to(values[:, None], (len(values), state.shape[1]))])
        new = np.empty_like(rows)
        code(rows, new, batch_parallel=batch_parallel)
        out[:] = new[: len(out)]

    return call, seconds


def _compiled(equations: Equations, method: Method) -> Any:
    """The map, compiled, compared with the portable one."""
    with announced(f"steps of {method.name} for {equations.robot.name}", step_seconds(equations, method)):
        compiled = compiled_map(equations, method)
        certify(equations, method, portable_map(equations, method), compiled)
    return compiled


def _in_parts(equations: Equations, method: Method, first: bool) -> tuple[Map, float]:
    """The map on a compiled rate and a compiled projection, and the seconds of making or loading them.

    first: for the first steps only, by code that is compiled sooner and runs longer. It serves other numbers too, but
    where whole steps are never compiled: as inputs, numbers make its compiling a quarter longer, and batches half.
    """
    base, constants, options, kind = equations, None, {}, "whole"
    if first:
        options, kind = UNOPTIMIZED, "first"
        if not equations.parameters and (equations.numbers_as_inputs or not in_parts(equations, method)):
            base, constants = structure_of(equations)

    def rate_code() -> Any:
        with announced(f"the motion of {equations.robot.name}", parts_seconds(equations)):
            return compiled_rate(base, **options)

    rate, seconds = compiled_function(base.key("rate", kind), rate_code)
    seconds += once(equations.key("rate", kind, "certified"), lambda: certify_rate(base, rate))
    projection = None
    if equations.constraints is not None:
        name = base.key("projection", kind)
        projection, more = compiled_function(name, lambda: compiled_projection(base, **options))
        more += once(equations.key("projection", kind, "certified"), lambda: certify_projection(base, projection))
        seconds += more
    return map_in_parts(equations, method, rate, projection, constants), seconds
