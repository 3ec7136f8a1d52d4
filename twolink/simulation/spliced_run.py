"""simulate, where located contacts cannot go on: they are stepped from there, or where that is not sound throughout.

    e(t) = e_stepped(t) + 2 d(t),   d(T) = e_located(T)     for t > T

T: the splice, just before the event that located contacts fail at. e_located(T): the error bar there. d: the distance
between two motions that are stepped alike, from the located state at T and from one that is displaced by the bar: how
an error at T grows. The bar before T is verified, what is behind it is an estimate.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twolink.contact.spliced import SplicedSolution, displaced
from twolink.contact.stepped_solution import SteppedSolution
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import STEPPED, Event
from twolink.scenes import Scene
from twolink.simulation.cost import together
from twolink.simulation.error_bar import error_bar
from twolink.simulation.stepped_run import PARTING, with_reason
from twolink.simulation.trajectory import Trajectory

NOT_LOCATED = ("no-impact", "no-consistent-mode", "indeterminate-forces", "no-single-point",
               "events-without-end")  # fmt: skip  # codes of contacts that stepping may solve
BEFORE = 1e-6, 1e-3  # of the time to the failure: so much before it the located part ends, also beside the run
COARSER = 2.0  # times: of the steps along which the growth of an error is looked at
Run = Callable[..., Trajectory]  # of times (n,); stepped also of a scene from the first of them, and of a step


def beyond_located(
    scene: Scene, times: np.ndarray, error: AccuracyError, located: Run, stepped: Run, *, best_effort: bool
) -> Trajectory:
    """The run of a scene for times (n,) whose located contacts failed with this error.

    Stepped throughout are scenes with controllers or sensors, whose memory at the splice is not known, and those whose
    located contacts fail at the start. Raises the error where stepping, which has no reflections, does not solve what
    failed, or with that way as a remedy where an accuracy or a method was asked for, and no best effort.
    """
    if error.code not in NOT_LOCATED or any(getattr(e, "impacts", "") == "reflections" for e in scene.effects):
        raise error
    if not best_effort:
        remedy = f'{error.remedy}; or contact="stepped" and step=1e-3, whose error is estimated'
        parts = {"where": error.where, "code": error.code, "run": error.run, **error.data}
        raise AccuracyError(error.what, remedy=remedy, **parts) from None
    remembers = scene.sensors or equations_of(scene, ticks=True).sampling is not None
    first = None if remembers else _located(error, located, times)
    if first is not None and first.interrupted:
        return first
    if first is not None:
        try:
            return _spliced(scene, times, error, first, stepped)
        except (AccuracyError, SceneError):
            pass  # what cannot be stepped from there, such as bodies that overlap by a rounding
    try:
        run = stepped(scene, times)
    except SceneError as other:
        if other.code != "not-stepped":
            raise
        error.run = error.run or first
        raise error from None
    return with_reason(run, f"stepped, for located at {error.where}: {error.what}")


def _located(error: AccuracyError, located: Run, times: np.ndarray) -> Trajectory | None:
    """The run up to just before the failure; None where there is none."""
    for share in BEFORE:
        end = (1.0 - share) * float(error.data.get("t", 0.0))
        if not end > times[0]:
            return None
        try:
            return located(np.append(times[times < end], end))
        except AccuracyError:
            continue
    return None


def _spliced(scene: Scene, times: np.ndarray, failure: AccuracyError, run: Trajectory, stepped: Run) -> Trajectory:
    """The located run and the one that is stepped from its end."""
    begin = float(run.t[-1])
    start = scene.with_start(run.q[-1], run.v[-1])
    after = np.append(begin, times[times > begin])
    rest, error = stepped(start, after), None
    if run.error is not None and rest.error is not None and rest.cost is not None:
        bar, speed = float(run.error[-1]), float(np.abs(run.v[-1]).max())
        rate = max(1.0 / begin, float(np.abs(run.acceleration[-1]).max()) / speed if speed else 0.0)
        others = start, scene.with_start(*displaced(start, bar, rate))
        one, other = (stepped(each, after, step=COARSER * rest.cost.setting, verify=False) for each in others)
        if not (one.interrupted or other.interrupted):
            apart = np.maximum(bar, equations_of(scene).space.distance(one.q, other.q))
            grown = error_bar(apart, np.zeros_like(apart), PARTING)
            error = np.concatenate([run.error, (rest.error + grown)[1:]])
    return _joined(run, rest, error, failure)


def _joined(run: Trajectory, rest: Trajectory, error: np.ndarray | None, failure: AccuracyError) -> Trajectory:
    """Both runs as one."""
    begin, first, second = float(run.t[-1]), run.solution, rest.solution
    if not (isinstance(first, DenseOutput) and isinstance(second, SteppedSolution) and run.cost and rest.cost):
        raise AccuracyError("no solution to go on from", where=f"t = {begin:.6g} s")
    event = Event(begin, STEPPED, "contacts", f"from here on the error is an estimate, for located {failure.what}")
    why = f"located until t = {begin:.6g} s, stepped from there, for {failure.what}; {rest.cost.why}"
    t, q, v = (np.concatenate([getattr(run, name), getattr(rest, name)[1:]]) for name in "tqv")
    return replace(rest, t=t, q=q, v=v, error=error, cost=together(rest.cost, [run.cost], why),
                   events=(*run.events, event, *rest.events), solution=SplicedSolution(first, second),
                   certificate=run.certificate, scene=run.scene)  # fmt: skip
