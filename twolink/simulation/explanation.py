"""explain: what a scene computes, what each effect costs, and how it would be solved; without running it to its end."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twolink.contact.choice import Choice, choose_contact_method
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import Solution
from twolink.integrate.solver import solve
from twolink.integrate.solvers.method_choice import MethodChoice
from twolink.integrate.solvers.taylor_code import Precision
from twolink.integrate.steps.programs import programs_of
from twolink.io.text import kebab_case
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import Plotted, plot_bars
from twolink.simulation.refinement import DIGITS, first_choice, precisions_of
from twolink.simulation.sampling import duration_for, sample_times, with_ends
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PILOT_STEPS = 2, 20  # of stepped contacts
BATCH = 1024  # worlds that an evaluation is timed in
PILOT = 0.05  # of the duration, from which the time of the whole is extrapolated
ROUNDS = 5
MAX_SECONDS = 1.0  # of solving a part of the run several times
DEMANDING = 1e-10  # rad or m: accuracies below may be out of reach of double precision
LONGEST_PILOT = 10.0  # simulated seconds
LONG = 1000  # characters of an effect with its fields


@dataclass(frozen=True)
class Share:
    """The number of operations that one effect adds to an evaluation."""

    effect: str
    operations: int


@dataclass(frozen=True, repr=False)
class Explanation(BaseResult, Plotted):
    """The computation of a scene: its formulation, operations, method and expected time.

    Parameters
    ----------
    scene : str
        Its title.
    effects : tuple of str
        Its effects with their fields.
    notes : tuple of str
        What effects say of themselves, such as which bodies may touch; and how contacts are computed.
    formulation : str
        The simplest that covers the effects.
    states : int
        Entries of x = (q, v).
    operations : int
        Operations of one evaluation of x' = f(t, x); equal ones are counted once.
    shares : tuple of Share
        Operations by effect.
    nanoseconds : (float, float) or None
        Of one evaluation in a batch, and alone, measured; None for SciPy's methods.
    method : str
    setting : float
        The method's tolerance, or its step, s.
    why : str
        The reason for the method.
    accuracy, duration : float
        Asked for, rad or m, and s.
    expected_seconds : float
        Of solving once, extrapolated from the first part of the run.
    """

    scene: str
    effects: tuple[str, ...]
    notes: tuple[str, ...]
    formulation: str
    states: int
    operations: int
    shares: tuple[Share, ...]
    nanoseconds: tuple[float, float] | None
    method: str
    setting: float
    why: str
    accuracy: float
    duration: float
    expected_seconds: float

    def _figure(self) -> Figure:
        names, counts = [share.effect for share in self.shares], [share.operations for share in self.shares]
        title = f"{self.scene}: {self.operations} operations an evaluation"
        return plot_bars(title, "operations that the effect adds", names, counts)

    def __repr__(self) -> str:
        lines = [
            self.scene,
            f"  effects      {', '.join(self.effects) or 'none: free motion'}",
            *(f"               {note}" for note in self.notes),
            f"  formulation  {self.formulation}, {self.states} states",
            f"  operations   {self.operations} an evaluation",
            *(f"    {share.operations:>8,}  {share.effect}" for share in self.shares),
        ]
        if self.nanoseconds is not None:
            batch, alone = self.nanoseconds
            lines.append(f"  evaluation   {batch:.1f} ns in a batch, {alone:.0f} ns alone (measured)")
        lines += [
            f"  method       {self.method}, setting {self.setting:.1e}: {self.why}",
            f"  expected     {self.expected_seconds:.2g} s for {self.duration:g} s at accuracy {self.accuracy:g}, "
            f"error bar{' and later events' if self.formulation.startswith('events') else ''} not included",
        ]
        return "\n".join(lines)


def explain(
    scene: Scene,
    duration: float | None = None,
    *,
    accuracy: float = 1e-6,
    t_eval: ArrayLike | None = None,
    samples_per_second: float = 200.0,
    method: str = "auto",
    contact: str | None = None,
) -> Explanation:
    """Say what a scene computes, what each effect costs, and how it would be solved.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float
        Bound on the global error of q, rad or m.
    t_eval, samples_per_second : optional
        The samples of the run, as in `simulate`.
    method : str
        "auto" or the name of a method.
    contact : {"located", "stepped"}, optional
        How contacts are computed, in place of what the scene calls for.

    Returns
    -------
    Explanation

    Raises
    ------
    SceneError, AccuracyError
        An argument does not fit, or the first part of the motion cannot be solved.
    """
    length, accuracy = duration_for(scene, duration), accuracy_of(accuracy)
    times = sample_times(length, t_eval, samples_per_second)
    chosen = choose_contact_method(scene, contact)
    if chosen.method == "stepped":
        return _of_steps(scene, chosen, accuracy, length)
    equations = equations_of(scene, ticks=True)
    more = precisions_of(equations) if method in ("auto", "taylor") else ()
    choice = first_choice(equations, accuracy, length, method, "auto", more if method == "auto" else ())
    acting = {i: one.held(scene.robot, i) for i, one in enumerate(scene.effects) if not one.is_sensor}
    fewer = {i: scene.with_effects([one for j, one in acting.items() if j != i]) for i in acting}
    taken = {i: equations.operations - equations_of(other).operations for i, other in fewer.items()}
    shares = [Share(kebab_case(type(effect).__name__), taken.get(i, 0)) for i, effect in enumerate(scene.effects)]
    return Explanation(
        scene.title or scene.robot.name,
        tuple(_shortened(repr(effect)) for effect in scene.effects),
        (*_notes(scene, chosen), *_digits(more, accuracy), *_states(equations)),
        _formulation(equations),
        equations.moving,
        equations.operations,
        tuple(shares),
        _nanoseconds(equations, choice),
        choice.method.name,
        choice.setting,
        choice.why,
        accuracy,
        length,
        _expected(equations, choice, with_ends(times, length)),
    )


def _shortened(text: str) -> str:
    """A text without the middle of what is long, such as the heights of a field."""
    return text if len(text) <= LONG else f"{text[: LONG // 2]} ... {text[-LONG // 2 :]}"


def _notes(scene: Scene, chosen: Choice) -> tuple[str, ...]:
    """Notes on the start and on the effects, and the choice of the contact method."""
    return (*scene.notes(), *([f"contacts are {chosen.method}: {chosen.why}"] if chosen.method else []))


def _states(equations: Equations) -> list[str]:
    """A note on the states of effects beside q and v, if there are any."""
    names = equations.space.states
    return [f"{', '.join(names)} are states of effects beside q and v"] if names else []


def _digits(more: tuple[Precision, ...], accuracy: float) -> list[str]:
    """A note on the digits that the accuracy may take."""
    if not more:
        return [] if accuracy >= DEMANDING else ["double precision only: the equations are not smooth, or not compiled"]
    return [f"where 16 digits do not keep the accuracy: {' or '.join(DIGITS[one] for one in more)}"]


def _of_steps(scene: Scene, chosen: Choice, accuracy: float, length: float) -> Explanation:
    """Explain a scene whose contacts are stepped through."""
    from twolink.contact.solver import (
        solve_stepped,
        stepper_of,  # which other scenes do not load
    )
    from twolink.simulation.stepped_run import FIRST

    stepper = stepper_of(scene)
    step = min(FIRST, length / 4)
    for count in PILOT_STEPS:  # the first ones build what they need
        pilot, start = min(length, count * step), time.perf_counter()
        solve_stepped(stepper, np.array([0.0, pilot]), step)
        taken = time.perf_counter() - start
        if taken > MAX_SECONDS / 4:
            break
    expected = taken * length / pilot
    return Explanation(
        scene.title or scene.robot.name,
        tuple(_shortened(repr(effect)) for effect in scene.effects),
        (*_notes(scene, chosen), *stepper.notes()),
        "impulses (time stepping: the error is estimated)",
        stepper.equations.moving,
        stepper.equations.operations,
        (),
        None,
        "stepped",
        step,
        "the first step, made smaller until the estimated error is below the accuracy",
        accuracy,
        length,
        expected,
    )


def _formulation(equations: Equations) -> str:
    loops = equations.constraints
    kind, text = "smooth", "forces: an ODE"
    if loops is not None:
        kind, text = "loops", f"{len(loops.kept)} constraints: an ODE with multipliers, projected after every step"
    if equations.has_events:
        return f"events ({text}, between events that are located)"
    return f"{kind} ({text})"


def _nanoseconds(equations: Equations, choice: MethodChoice) -> tuple[float, float] | None:
    """One evaluation in a batch and alone, ns, on one thread."""
    if choice.method.kind == "scipy" or equations.space.size == 0:
        return None
    rate = programs_of(equations).rate

    def call_with(worlds: int) -> Callable[[], object]:
        rows = np.repeat(np.concatenate([[0.0], equations.start])[:, None], worlds, axis=1)
        out = np.empty((rate.outputs, worlds))
        return lambda: rate(rows, out)

    batch, alone = (_median_nanoseconds(call_with(worlds), worlds) for worlds in (BATCH, 1))
    return batch, alone


def _median_nanoseconds(call: Callable[[], object], evaluations: int) -> float:
    """Nanoseconds an evaluation, of a call that makes so many."""
    call()
    calls, rounds = max(1, 8192 // evaluations), []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(calls):
            call()
        rounds.append((time.perf_counter() - start) / calls)
    return 1e9 * float(np.median(rounds)) / evaluations


def _expected(equations: Equations, choice: MethodChoice, times: np.ndarray) -> float:
    """Seconds of solving once for samples at the times (n,): two first parts give the cost of a call and of time."""
    duration = float(times[-1])

    def solved(part: float) -> Solution:
        first = np.append(times[times < part * pilot], part * pilot)
        return solve(equations, choice.method, first, choice.setting, None, choice.precision)

    def seconds(part: float) -> float:
        solved(part)  # traces what is not traced yet
        taken: list[float] = []
        while len(taken) < ROUNDS and sum(taken) < MAX_SECONDS:
            start = time.perf_counter()
            compiling = solved(part).compile_seconds
            taken.append(time.perf_counter() - start - compiling)
        return min(taken)

    pilot = min(duration, LONGEST_PILOT / PILOT)
    short, long = seconds(PILOT), seconds(2 * PILOT)
    return short + max(0.0, long - short) * (duration / pilot - PILOT) / PILOT
