"""explain: what a scene computes, what each effect costs, and how it would be solved; without running it to its end."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twolink.contact.choice import Choice, choose_contact_method
from twolink.dynamics.arguments import Positive
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solver import ATTEMPTS, MEASURED, MethodChoice, is_stepping
from twolink.integrate.solvers.taylor import Precision, order_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import NO_PERTURBATION
from twolink.integrate.steps.step_control import RESOLUTION
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import advance, start_state
from twolink.io.text import kebab_case
from twolink.native.speed import nanoseconds_of_operation
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of, fall_notes
from twolink.show.figure import Plotted, plot_bars
from twolink.simulation.refinement import DIGITS, first_choice, precisions_of
from twolink.simulation.sampling import duration_for, sample_times, with_ends
from twolink.simulation.scene_run import ACCURACY
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PILOT_STEPS = 2, 20  # of stepped contacts
MAX_SECONDS = 0.25  # of those
FIGURES_TOLERANCE = 1e-3  # of the figures of `integrate.solver`
PILOT = 10  # first steps, from whose second half the number of all is extrapolated
PILOT_TOLERANCE = 1e-10  # of those in place of methods that have none
CALL, STEP = 5e-4, 1e-6  # s: of a run and of a step, beside their operations
FIXED = 30  # operations that an evaluation takes beside its own
SLOPE = 0.3  # operations of a column of the Jacobian, of those of the rate
SINES = 8  # operations of a joint's sine and cosine, beyond the two that are counted
DIGITS_COST: dict[Precision, float] = {"double": 0.5, "extended": 3.0, "quad": 60.0}  # of a product in Taylor's method
DEMANDING = 1e-10  # rad or m: accuracies below may be out of reach of double precision
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
        Of one evaluation in a batch, and alone: its operations at the price of one on this processor, true within a
        factor of 2.5; None for SciPy's methods.
    method : str
    setting : float
        The method's tolerance, or its step, s.
    why : str
        The reason for the method.
    accuracy, duration : float
        Asked for, rad or m, and s.
    expected_seconds : float
        Of solving once: the steps, extrapolated from the first ones, at the price of their operations; true within a
        factor of 6 where the motion goes on as it begins.
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
            lines.append(f"  evaluation   {batch:.1f} ns in a batch, {alone:.0f} ns alone (by the operations)")
        lines += [
            f"  method       {self.method}, setting {self.setting:.1e}: {self.why}",
            f"  expected     {self._expected()}",
        ]
        return "\n".join(lines)

    def _expected(self) -> str:
        """The expected time, in words."""
        what = f"{self.expected_seconds:.2g} s for {self.duration:g} s"
        if self.method == "stepped":
            return f"{what} in such steps; a tenth of the error takes about ten times that"
        later = " and later events" if self.formulation.startswith("events") else ""
        return f"{what} at accuracy {self.accuracy:g}, error bar{later} not included"


def explain(
    scene: Scene,
    duration: Positive | None = None,
    *,
    accuracy: Positive | None = None,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 200.0,
    method: str = "auto",
    contact: str | None = None,
) -> Explanation:
    """Say what a scene computes, what each effect costs, and how it would be solved.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float, optional
        Bound on the global error of q, rad or m; by default 1e-6.
    t_eval, samples_per_second : optional
        The samples of the run, as in `simulate`.
    method : str
        "auto" or the name of a method.
    contact : {"located", "stepped"}, optional
        How contacts, stops and dry friction are computed, in place of what the scene calls for.

    Returns
    -------
    Explanation

    Raises
    ------
    SceneError, AccuracyError
        An argument does not fit, or the first part of the motion cannot be solved.
    """
    length, accuracy = duration_for(scene, duration), accuracy_of(ACCURACY if accuracy is None else accuracy)
    times = sample_times(length, t_eval, samples_per_second)
    chosen = choose_contact_method(scene, contact)
    if chosen.method == "stepped":
        return _of_steps(scene, chosen, accuracy, length)
    equations = equations_of(scene, ticks=True)
    more = precisions_of(equations) if method in ("auto", "taylor") else ()
    choice = first_choice(equations, accuracy, length, method, "auto", more if method == "auto" else ())
    acting = {i: one.held(scene.robot, i) for i, one in enumerate(scene.effects) if not one.is_sensor}
    fewer = {i: scene.with_effects([one for j, one in acting.items() if j != i]) for i in acting}
    counts = {i: equations_of(other, variant=equations.variant).operations for i, other in fewer.items()}
    taken = {i: equations.operations - count for i, count in counts.items()}
    shares = [Share(kebab_case(type(effect).__name__), taken.get(i, 0)) for i, effect in enumerate(scene.effects)]
    return Explanation(
        scene.title or scene.robot.name, tuple(_shortened(repr(effect)) for effect in scene.effects),
        (*_notes(scene, chosen), *_digits(more, accuracy), *_states(equations), *_laws(equations)),
        _formulation(equations), equations.moving, equations.operations, tuple(shares),
        _nanoseconds(equations, choice), choice.method.name, choice.setting, choice.why, accuracy, length,
        _expected(equations, choice, with_ends(times, length)),
    )  # fmt: skip


def _shortened(text: str) -> str:
    """A text without the middle of what is long, such as the heights of a field."""
    return text if len(text) <= LONG else f"{text[: LONG // 2]} ... {text[-LONG // 2 :]}"


def _notes(scene: Scene, chosen: Choice) -> tuple[str, ...]:
    """Notes on the start and on the effects, and the choice of the contact method."""
    contacts = [f"contacts are {chosen.method}: {chosen.why}"] if chosen.method else []
    return (*scene.notes(), *fall_notes(scene), *contacts)


def _states(equations: Equations) -> list[str]:
    """A note on the states of effects beside q and v, if there are any."""
    names = equations.space.states
    return [f"{', '.join(names)} are states of effects beside q and v"] if names else []


def _laws(equations: Equations) -> list[str]:
    """Notes on how the laws of sampled controllers are asked, by all solutions of an error bar."""
    if equations.sampling is None:
        return []
    from twolink.integrate.forces_seen import forces_seen
    from twolink.loop.sampled_loop import SampledLoop  # which other scenes do not load

    layout, x = equations.layout, np.repeat(equations.start[:, None], 3, axis=1)
    return SampledLoop(equations.sampling, layout.rows_of_slots(), layout.space.states, x,
                       lambda t, x: forces_seen(equations, t, x)).notes()  # fmt: skip


def _digits(more: tuple[Precision, ...], accuracy: float) -> list[str]:
    """A note on the digits that the accuracy may take."""
    if not more:
        return [] if accuracy >= DEMANDING else ["double precision only: the equations are not smooth, or not compiled"]
    return [f"where 16 digits do not keep the accuracy: {' or '.join(DIGITS[one] for one in more)}"]


def _of_steps(scene: Scene, chosen: Choice, accuracy: float, length: float) -> Explanation:
    """Explain a scene whose contacts are stepped through."""
    from twolink.contact.solver import solve_stepped, stepper_of  # which other scenes do not load
    from twolink.simulation.stepped_run import FIRST, most_steps

    stepper = stepper_of(scene)
    step = min(FIRST, length / 4)
    for count in PILOT_STEPS:  # the first ones build what they need
        pilot, start = min(length, count * step), time.perf_counter()
        solve_stepped(stepper, np.array([0.0, pilot]), step)
        taken = time.perf_counter() - start
        if taken > MAX_SECONDS:
            break
    expected = taken * length / pilot
    return Explanation(
        scene.title or scene.robot.name,
        tuple(_shortened(repr(effect)) for effect in scene.effects),
        (*_notes(scene, chosen), *stepper.notes(), *_laws(stepper.equations)),
        "impulses (time stepping: the error is estimated)",
        stepper.equations.moving,
        stepper.equations.operations,
        (),
        None,
        "stepped",
        step,
        "the first step, made smaller until the estimated error is below the accuracy; without one while that helps, "
        f"at most {most_steps(scene, stepper):,.0f} of them",
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
    """One evaluation in a batch and alone, ns, on one thread: the operations, at what one takes on this processor."""
    if choice.method.kind == "scipy" or equations.space.size == 0:
        return None
    work = FIXED + equations.operations + SINES * equations.space.nv
    batch, alone = nanoseconds_of_operation()
    return work * batch, work * alone


def _expected(equations: Equations, choice: MethodChoice, times: np.ndarray) -> float:
    """Seconds of solving once for samples at the times (n,)."""
    if equations.space.size == 0:
        return 0.0
    method, size, operations = choice.method, equations.moving, equations.operations
    steps, (batch, alone) = _steps(equations, choice, float(times[-1])), nanoseconds_of_operation()
    if method.kind == "taylor":
        work = steps * operations * order_of(choice.setting) ** 2 * DIGITS_COST[choice.precision]
    else:  # a sample is one step more; all of them are a batch
        work = (steps + len(times) * batch / alone) * operations * method.evaluations
    if method.kind == "implicit":  # the Jacobian, its factors, and a solution an iteration
        work += steps * (size * SLOPE * operations + size**3 / 3 + method.evaluations * size**2)
    return CALL + STEP * steps + 1e-9 * work * alone


def _steps(equations: Equations, choice: MethodChoice, duration: float) -> float:
    """Steps of a run, from the lengths of its first ones, which Pinocchio's rates make: without tracing."""
    method, setting = choice.method, choice.setting
    if not method.adaptive:
        return duration / setting
    if method.kind == "implicit":  # whose first steps say little: they grow from the shortest ones
        count, growth = ATTEMPTS[method.name]
        return float(count * (FIGURES_TOLERANCE / setting) ** growth * duration / MEASURED)
    if not is_stepping(method):
        method, setting = METHODS["dop853"], max(setting, PILOT_TOLERANCE)
    by = step_map(equations, method, portable=True)
    end = min((*equations.breaks(duration), duration))
    state, limit = start_state(by, equations.start[:, None], 0.0, end, setting, span=duration)
    t = next(advance(by, state, limit, PILOT, (NO_PERTURBATION,))).t[:, 0]
    half = len(t) // 2 if t[-1] < end else 0  # the first steps grow
    taken = max(float(t[-1] - t[half]), RESOLUTION * duration)
    ticks = 0.0 if equations.sampling is None else equations.sampling.ticks_per_second * duration
    return max((len(t) - 1 - half) / taken * duration, ticks)
