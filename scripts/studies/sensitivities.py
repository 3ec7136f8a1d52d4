"""Do the error bars of sensitivities hold? Random scenes, each differentiated and compared with differences of runs.

    python -m scripts.studies.sensitivities [--scenes 100] [--seed 0] [--first 0] [--out FILE]

Scenes: those of `scenes.exact` that are smooth, have joints of all kinds, are unstable, have loops or events in closed
form, and arms with stops, dry friction, releases, detents and planes. By what: the start, and constants drawn at random
from those of the robot and of the effects.

Truth: differences of order 8 and 6 of tight runs beside the scene, in quad precision where the scene is smooth, by
code that takes the scene's constants as inputs and so is compiled once for all of them.
Their distance is the truth's own doubt; samples where it is above a tenth of the bar do not count, such as those beside
an event, and those where an unstable motion has carried the runs beside it far away. A bar fails where one entry of a
sample is farther from the truth than it says. Rows go to out/sensitivities-SEED.csv. Ends 0 if no bar fails.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import twolink as tl
from scripts.heyoka_peer import heyoka, system_of
from scripts.runner import Bars, Judged, Table, study
from scripts.studies.scenes.exact import Case, events, joints, loops, smooth, unstable
from twolink import effects as fx
from twolink.algorithms.mechanism import nominal, parameter_names
from twolink.effects.conditions import JointReaches
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.effect_numbers import nominal_value
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of, structure_of, with_parameters
from twolink.integrate.solver import choose
from twolink.scenes.parameters import effect_numbers, scene_with
from twolink.simulation.scene_run import run_of
from twolink.simulation.time_limit import OutOfTime, TimeLimit

SAMPLES, LONGEST, PATIENCE = 40, 4.0, 20.0  # of a scene; s of motion; s of a run
COLUMNS = 4  # compared of a scene, drawn at random
KNOWN = 0.1  # of the bar: where the truth's own doubt is larger, it does not judge
SIXTH = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
EIGHTH = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
STEP, SMOOTH_STEP = 1e-3, 2e-3  # of differences through events, and without any
TIGHT, QUAD = 1e-13, 1e-22  # accuracy of runs in double precision, tolerance of those in quadruple precision
ROUNDING = 1e-12  # relative: of differences in the tangent space
NEARER = 0.01  # of the step, where what is moved so far cannot exist
FARTHEST = 1.0  # rad or m, between the outermost runs: beyond it differences of all orders agree on what is wrong
FEWEST = 50  # steps in quadruple precision, where the size of a step may be misjudged at symmetric rest
LOAD = fx.Payload("forearm", 1.0, (0.0, 0.0, 0.3))


@dataclass
class Row(Judged):
    """A scene and what came of it. worst: the largest error over its bar. tightness: bars over errors at the end."""

    outcome: str = "compared"
    columns: int = 0
    samples: int = 0
    failed: int = 0
    tightness: str = ""

    @property
    def fails(self) -> bool:
        return self.failed > 0


def arm(random: np.random.Generator) -> Case:
    """The paper's arm with one thing that switches."""
    low, high = -random.uniform(0.2, 0.8), random.uniform(0.6, 1.2)
    things: dict[str, tl.effects.Effect] = {
        "stops": fx.JointStops({"elbow": (low, high)}, random.uniform(0.0, 0.8)),
        "friction": fx.DryFriction({"elbow": random.uniform(0.5, 3.0), "shoulder": random.uniform(0.1, 1.0)}),
        "static": fx.DryFriction({"elbow": 2.0}, {"elbow": random.uniform(2.2, 3.0)}),
        "release": fx.Release(LOAD, at=random.uniform(0.2, 0.9)),
        "release at": fx.Release(fx.Torque({"elbow": fx.Sine(2.0, 5.0)}), when=JointReaches("shoulder", -0.5)),
        "detent": fx.Detent("elbow", random.uniform(20.0, 99.0), (float(low),), 9.0),
        "effort": fx.JointPD({"elbow": 0.5}, {"elbow": 9.0}, effort={"elbow": random.uniform(2.0, 5.0)}),
        "plane": fx.PlaneContact("forearm", (1.0, 0.0, 0.0), 0.05, height=-0.9, restitution=random.uniform(0.3, 0.9),
                                 friction=random.uniform(0.0, 0.3)),
    }  # fmt: skip
    what = str(random.choice(list(things)))
    q, v = random.uniform(0.1, 0.5, 2), random.uniform(-1.5, 0.5, 2)
    scene = tl.Scene(tl.load_robot("two_link"), q, v, [fx.Gravity(), things[what]])
    return Case(f"arm, {what}", scene, float(random.uniform(0.6, 1.4)), lambda t: (t, t))


KINDS: dict[str, Callable[[np.random.Generator, np.random.Generator], Case]] = {
    "smooth": smooth, "joints": joints, "unstable": unstable, "loops": loops, "events": events,
    "arms": lambda _, random: arm(random), "arms ": lambda _, random: arm(random),
}  # fmt: skip


def named(scene: tl.Scene, random: np.random.Generator) -> list[str]:
    """By what a scene is differentiated."""
    switching, has_loops = equations_of(scene).has_events, equations_of(scene).constraints is not None
    constants = [name for name in parameter_names(scene.robot.model)
                 if nominal(scene.robot.model, name) and not (has_loops and ".origin." in name)
                 and not name.endswith(".damping")]  # fmt: skip
    numbers = [name for name, value in effect_numbers(scene).items() if np.isfinite(value) and value
               and not any(part in name for part in ("normal", "point", "inertia", "direction"))]  # fmt: skip
    chosen = list(random.choice(constants, 1))
    if numbers:
        chosen += list(random.choice(numbers, min(len(numbers), 3 if switching else 1), replace=False))
    return ["q", "v", *dict.fromkeys(map(str, chosen))]


def beside(scene: tl.Scene, name: str, column: int, shift: float) -> tl.Scene:
    """The scene with one number moved."""
    if name not in ("q", "v"):
        return scene_with(scene, {name: number_of(scene, name) + shift})
    change = np.zeros(scene.robot.nv)
    change[column] = shift
    q = scene.robot.integrate(scene.q, change) if name == "q" else scene.q
    return tl.Scene(scene.base, q, scene.v + change * (name == "v"), scene.effects, scene.duration)


class Beside:
    """Tight runs beside a scene at the same times, for differences; one code serves all of them."""

    def __init__(self, scene: tl.Scene, names: list[str], times: np.ndarray) -> None:
        self.scene, self.times = scene, times
        own = equations_of(scene)
        self.precise = own.analytic and not own.breaks(float(times[-1]))
        self.step = SMOOTH_STEP if not own.has_events else STEP
        if self.precise:
            base, known = structure_of(own)[0], parameter_names(scene.robot.model)
            lengths = [name for name in names if name in known and name not in base.parameters]
            self.equations = with_parameters(own, (*base.parameters, *lengths))
            self.integrator = quad_integrator(self.equations)

    def states(self, moved: tl.Scene, limit: TimeLimit) -> np.ndarray:
        """(q, v) at the times, (n, nq + nv), up to the event that ends the run."""
        equations, end = equations_of(moved), float(self.times[-1])
        if not self.precise:
            equations = replace(equations, numbers_as_inputs=True)
            choice = choose(equations, TIGHT, end, "dop853")
            run = run_of(moved, equations, choice, self.times, TIGHT, limit, verify=False)
            alike = run.t == self.times[: len(run.t)]
            return np.concatenate([run.q, run.v], axis=1)[alike]
        real, one = heyoka().real128, self.integrator
        one.time, one.state[:] = real(0.0), equations.start[: equations.moving].astype(real)
        numbers = [*equations.start[equations.moving :],
                   *(nominal_value(equations, name) for name in self.equations.parameters)]  # fmt: skip
        one.pars[:] = np.array(numbers).astype(real)[: len(one.pars)]
        found = one.propagate_grid(self.times.astype(real), max_delta_t=real(end / FEWEST))
        if found[0] != heyoka().taylor_outcome.time_limit:
            raise AccuracyError("no motion in quadruple precision", where="truth")
        return np.asarray(found[-1])

    def derivatives(self, name: str, column: int) -> tuple[np.ndarray, np.ndarray]:
        """d(q, v)/dp (n, 2 nv) at the samples, and its doubt (n,)."""
        scene, limit = self.scene, TimeLimit(PATIENCE, clock=time.process_time)
        value = 1.0 if name in ("q", "v") else abs(number_of(scene, name))
        h = self.step * min(1.0, value or 1.0)
        try:
            [beside(scene, name, column, k * h) for k in (-4, 4)]
        except SceneError:  # no such body: nearer ones can exist
            h *= NEARER
        states = {k: self.states(beside(scene, name, column, k * h), limit) for k in range(-4, 5)}
        nq, nv, length = scene.robot.nq, scene.robot.nv, min(map(len, states.values()))
        own = states[0][:length].astype(float)

        def differences(weights: tuple[tuple[int, float], ...]) -> np.ndarray:
            change = sum(w * (states[k][:length] - states[-k][:length]).astype(float) for k, w in weights) / h
            along = change[:, :nq]
            if nq != nv:
                along = tangent(scene.robot, own[:, :nq], along)
            return np.concatenate([along, change[:, nq:]], axis=1)

        best = differences(EIGHTH)
        rounding = 1e-16 * value if self.precise else TIGHT * (1.0 + np.abs(own).max(axis=1))  # of what is moved
        doubt = np.abs(best - differences(SIXTH)).max(axis=1)
        doubt += (rounding / h + ROUNDING) * (1.0 + np.abs(best).max(axis=1))
        doubt[np.abs(8 * h * best).max(axis=1) > FARTHEST] = np.inf
        return best, np.nan_to_num(doubt, nan=np.inf)


def quad_integrator(equations: Equations) -> Any:
    """heyoka's Taylor integrator in quadruple precision, with the equations' parameters as its own."""
    module, start = heyoka(), [heyoka().real128(0.0)] * equations.moving
    return module.taylor_adaptive(system_of(equations), start, compact_mode=True, fp_type=module.real128,
                                  tol=module.real128(QUAD))  # fmt: skip


def tangent(robot: tl.Robot, q: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Changes of the entries of q (n, nq) as tangent vectors (n, nv), by differences of order 8 of small steps."""
    h = 1e-2 / (1.0 + np.abs(along).max())

    def moved(k: int) -> np.ndarray:
        return np.asarray(robot.difference(q, robot.normalize(q + k * h * along)))

    return np.asarray(sum(weight * (moved(k) - moved(-k)) for k, weight in EIGHTH) / h)


def number_of(scene: tl.Scene, name: str) -> float:
    """The value that a constant has in a scene."""
    own = effect_numbers(scene)
    return own[name] if name in own else nominal(scene.robot.model, name)


def check(number: int, given: argparse.Namespace) -> Row:
    """Differentiate one scene, and compare."""
    kind = list(KINDS)[number % len(KINDS)]
    random = np.random.default_rng([given.seed, number])
    one = KINDS[kind](np.random.default_rng([given.seed, number // 48, 7]), random)
    scene, duration = one.scene, min(one.duration, LONGEST)
    row = Row(number, kind.strip(), one.what)
    names = named(scene, random)
    accuracy = float(10 ** random.uniform(-7, -3))
    while True:
        try:
            s = tl.sensitivities(scene, wrt=names, duration=duration, accuracy=accuracy,
                                 samples_per_second=SAMPLES / duration)  # fmt: skip
            break
        except (AccuracyError, SceneError) as error:
            t = float(getattr(error, "t", 0.0)) if isinstance(error, AccuracyError) else 0.0
            if "held there" in error.what and len(names) > 1:
                names = names[2:] if names[0] == "q" else names[1:]
            elif error.code == "sensitivity-undefined" and t > 0.2 * duration:
                duration = 0.95 * t
            else:
                row.outcome = error.code or "refused"
                return row
    columns = [(name, k) for name in names for k in range(s.q[name].shape[2])]
    chosen = [columns[i] for i in random.permutation(len(columns))[:COLUMNS]]
    runs = Beside(scene, [name for name, _ in chosen], s.run.t)
    for name, column in chosen:
        compare(row, runs, s, name, column)
    return row


def compare(row: Row, runs: Beside, s: tl.Sensitivities, name: str, column: int) -> None:
    """Count how one column compares with its truth."""
    try:
        exact, doubt = runs.derivatives(name, column)
    except (AccuracyError, SceneError, OutOfTime) as error:
        row.outcome = f"no truth: {error}"[:60]
        return
    ours = np.concatenate([s.q[name], s.v[name]], axis=1)[: len(exact), :, column]
    bar, errors = s.error[name][: len(exact)], np.abs(ours - exact).max(axis=1)
    sure = doubt <= KNOWN * bar
    row.columns += 1
    row.samples += int(sure.sum())
    row.failed += int(((errors > bar + doubt) & sure).sum())
    row.worst = max(row.worst, float((errors[sure] / bar[sure]).max(initial=0.0)))
    if sure[-1] and errors.max():
        row.tightness += f" {bar[-1] / errors[sure].max():.4g}"


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The scenes, and what they say together."""
    table = Table("scene >5 | kind <9 | what <28 | outcome <24 | columns >7 | samples >7 | beyond >6 | worst >8.2g | "
                  "s >6.1f")  # fmt: skip
    for row in rows:
        table.add(row.scene, row.kind, row.what[:28], row.outcome, row.columns, row.samples, row.failed, row.worst,
                  row.seconds)  # fmt: skip
    failing, tight = sum(row.fails for row in rows), [float(x) for row in rows for x in row.tightness.split()]
    compared, columns = sum(row.samples > 0 for row in rows), sum(row.columns for row in rows)
    samples = sum(row.samples for row in rows)
    print(f"\n{len(rows)} scenes, {compared} compared in {columns} columns and {samples} samples; "
          f"median bar over error {np.median(tight or [np.nan]):.1f}")  # fmt: skip
    return [(not failing, f"scenes with an error beyond its bar: {failing} (bar: none)")]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "sensitivities", Row, check, show))
