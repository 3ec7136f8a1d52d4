"""Does every error bar of a sampled loop hold? Random loops, each against a run of 33 digits from tick to tick.

    python -m scripts.studies.loops [--scenes 100] [--seed 0] [--first 0]

The paper's arm with gravity and damping under one to three controllers: P, PD or PID, with stable and unstable gains,
periods of 1 to 25 ms, delays up to several periods, jitter, saturation, both holds, encoders of 8 to 20 bits.
The second way shares the random numbers of the jitter and the laws; its clock is a list of fractions, and between two
instants Taylor's method solves with 33 digits.

In half of the scenes the first controller remembers something beside its state: a counter, a latch, a thermostat, a
filter, in one of the places of `hidden_laws`, or it answers by noise, a clock or a table. The motion meant is that of
the same law with the memory as its state. These are solved alone, as the second of two worlds, and step by step after
a first motion that was broken off; some with a watch, whose events are located.

holds; WRONG: a sample is farther off than its error bar; a code: a named error without a run, of laws that remember
"controller-not-repeatable" or "controller-not-copied"; REFUSED: that of a law that should be solved; CRASH: any other
error. Rows go to out/loops-SEED.csv. Ends 0 if no bar is wrong, and nothing is refused or crashes that should not.
"""

import argparse
import collections
import functools
import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

import twolink as tl
from scripts.heyoka_peer import integrator, number_type
from scripts.runner import Bars, Judged, study
from scripts.studies.hidden_laws import COPIED, HARMLESS, HOLDERS, PLAIN, behaviour, pure
from twolink import effects as fx
from twolink.effects.inputs import Slot
from twolink.effects.sampled_control import HeldTorques, exact
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.scene_equations import make_equations
from twolink.loop.clock import ACT, PARTS, READ, UPDATE, Random
from twolink.loop.laws import Measured

SECONDS, SAMPLES, LIMITS = Fraction(1, 2), 21, (5.0, 20.0, 60.0)
SAMPLE = 9  # after all else that happens at an instant
REFUSALS = "controller-not-repeatable", "controller-not-copied"
TIMES = [k * SECONDS / SAMPLES for k in range(SAMPLES + 1)]
# The pure scene, all times, and at the last of them q (n, 2), the bars (n,), and the events.
Solved = tuple[tl.Scene, list[Fraction], np.ndarray, np.ndarray, Any]
DAMPING = {"shoulder": 0.5, "elbow": 0.5}


@dataclass
class Row(Judged):
    """A loop and what came of it. worst: the largest error in a part of its bar. bar: at the end, rad.

    holder, way: where a law remembers something, and how the loop is solved.
    """

    holder: str = ""
    way: str = ""
    bar: float = 0.0
    ambiguous: int = 0
    ticks: int = 0


def law(kind: int, kp: float, kd: float, ki: float, period: float, name: str) -> Callable[..., Any]:
    """P, PD or PID on what is measured; an encoder's velocity is a difference."""

    def update(_: float, y: Any, state: Any) -> Any:
        before, total = state
        q = y.q if name == "q" else y[name]
        v = y.v if name == "q" else (q - before) / period
        total = total + period * (0.4 - q)
        return kp * (0.4 - q) - (kd * v if kind else 0.0) + (ki * total if kind > 1 else 0.0), (q, total)

    return update


def holder_of(number: int) -> str:
    """Where the first law of a scene remembers something; "": nowhere."""
    return [*HOLDERS][number // 4 % len(HOLDERS)] if number % 4 >= 2 else ""


def random_scene(number: int, seed: int, *, hidden: bool = True) -> tl.Scene:
    """The arm under its controllers. hidden: whether the first one hides what it remembers, where it does."""
    holder, remembers = holder_of(number), np.random.default_rng((seed, number, 1))
    rng, arm = np.random.default_rng((seed, number)), tl.load_scene("arm-swing")
    q, effects = rng.uniform(-1.0, 1.0, 2), [fx.Gravity(), fx.JointDamping(DAMPING)]
    for i in range(rng.integers(1, 4)):
        period = Fraction(1, int(np.exp(rng.uniform(np.log(40), np.log(1000)))))
        delay = float(rng.choice([0.0, float(period), rng.uniform(0.0, 3.0) * float(period)]))
        sensed, kind, gain = f"encoder{i}" if rng.random() < 0.4 else "q", int(rng.integers(3)), rng.uniform(0.3, 2.0)
        update = law(kind, 40.0 * gain, 8.0 * gain, 30.0 * gain, float(period), sensed)
        if sensed != "q":
            quantum = float(2 * np.pi / 2 ** rng.integers(8, 21))
            effects.append(fx.Encoder(arm.robot.joint_names, name=sensed, period=float(period), quantum=quantum))
        jitter = float(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.9)]) * float(period))
        inputs, start = (("q", "v") if sensed == "q" else (sensed, "q")), (q.copy(), np.zeros(2))
        if holder and not i:
            step, memory = behaviour(remembers, int(SECONDS / period))
            if hidden:
                update = HOLDERS[holder](update, step, memory)
            elif holder not in PLAIN:
                update, start = pure(update, step), (start, memory)
        limit = dict.fromkeys(arm.robot.joint_names, float(rng.choice(LIMITS)))
        hold = "first" if rng.random() < 0.2 else "zero"
        effects.append(fx.Controller(update, period, delay=delay, jitter=jitter, seed=number, inputs=inputs,
                                     state=start, hold=hold, limit=limit))  # fmt: skip
    if holder and remembers.random() < 0.3:
        effects.append(fx.Watch("far", when=fx.JointReaches("elbow", 50.0)))
    return tl.Scene(arm.base, q, rng.uniform(-1.0, 1.0, 2), effects, duration=float(SECONDS))


@functools.cache
def motion() -> Any:
    """heyoka's integrator of the damped arm under held torques."""
    robot = tl.load_scene("arm-swing").robot
    values, slopes = ({j: Slot(f"{what} {j}") for j in robot.joint_names} for what in ("value", "slope"))
    acting = [fx.JointDamping(DAMPING), HeldTorques(values, slopes, Slot("since"))]
    equations = make_equations(robot, np.zeros(2), np.zeros(2), [*enumerate(acting)])
    return integrator(equations, 1e-30, "quad", compact_mode=True)


class Truth:
    """The motion of a scene with 33 digits, from instant to instant."""

    def __init__(self, scene: tl.Scene) -> None:
        self.number, self.motion = number_type("quad"), motion()
        self.motion.time = self.number(0)
        self.motion.state[:] = np.array([*scene.q, *scene.v, 0.0]).astype(self.number)
        self.motion.pars[:] = np.zeros(len(self.motion.pars)).astype(self.number)  # it was used before
        self.parts: dict[int, Any] = {i: one for i, one in enumerate(scene.effects) if one.is_sensor or one.sampled}
        self.memory = {i: one.state for i, one in self.parts.items() if one.sampled}
        self.lines: dict[int, tuple[np.ndarray, np.ndarray, float]] = {}  # of each controller: value, slope, since
        self.readings: dict[str, np.ndarray] = {}
        self.ticks = 0

    def at(self, times: list[Fraction]) -> np.ndarray:
        """q at times that increase (n, 2)."""
        agenda = [(t, SAMPLE, 0, 0) for t in times]
        for i, one in self.parts.items():
            agenda += rhythm(i, one, times[-1])
        heapq.heapify(agenda)
        answers, out = {}, []
        while agenda:
            t, what, i, k = heapq.heappop(agenda)
            if t > times[-1]:
                break
            self.motion.propagate_until(self.number(t.numerator) / self.number(t.denominator))
            x = self.motion.state[:4].astype(float)
            if what == SAMPLE:
                out.append(x[:2])
            elif what == READ:
                quantum = self.parts[i].quantum
                self.readings[self.parts[i].label] = quantum * np.round(x[:2] / quantum)
            elif what == UPDATE:
                y = Measured(q=x[:2], v=x[2:], **self.readings)
                u, self.memory[i] = self.parts[i].update(float(t), y, self.memory[i])
                answers[i, k] = np.clip(u, -self.bound(i), self.bound(i))
                heapq.heappush(agenda, (t + exact(self.parts[i].delay), ACT, i, k))
                self.ticks += 1
            else:
                self.act(i, float(t), answers.pop((i, k)))
        return np.array(out)

    def bound(self, i: int) -> float:
        return float(next(iter(self.parts[i].limit.values())))

    def act(self, i: int, t: float, u: np.ndarray) -> None:
        """Take new torques."""
        one, slope, bound = self.parts[i], np.zeros(2), self.bound(i)
        if one.hold == "first" and i in self.lines:
            (before, _, since), longest = self.lines[i], float(one.period + one.jitter)  # until the next
            slope = np.clip((u - before) / (t - since), (-bound - u) / longest, (bound - u) / longest)
        self.lines[i] = (u, slope, t)
        values = sum(u.astype(self.number) - s.astype(self.number) * self.number(t) for u, s, t in self.lines.values())
        slopes = sum(s.astype(self.number) for _, s, _ in self.lines.values())
        rows = np.concatenate([values, slopes, np.zeros(1).astype(self.number)])
        self.motion.pars[:] = rows[: len(self.motion.pars)]


def rhythm(i: int, one: Any, end: Fraction) -> Iterator[tuple[Fraction, int, int, int]]:
    """The ticks of a sensor or a controller."""
    random, what = Random(one.seed, f"controller {i}"), READ if one.is_sensor else UPDATE
    for k in range(int(end / exact(one.period)) + 1):
        late = exact(getattr(one, "jitter", 0.0)) * int(random(k)[2, 0]) / PARTS
        yield k * exact(one.period) + late, what, i, k


def check(number: int, given: argparse.Namespace) -> Row:
    """A loop and what came of it."""
    holder, way = holder_of(number), WAYS[number // 4 % 3] if number % 4 >= 2 else "run"
    row = Row(number, holder=holder, way=way)
    try:
        scene, twin = random_scene(number, given.seed), random_scene(number, given.seed, hidden=False)
        try:
            twin, times, q, error, events = SOLVED[way](scene, twin, number)
        except AccuracyError as failed:
            if failed.run is None or way != "run":
                return replace(row, outcome=failed.code)
            times, q, error, events = TIMES, failed.run.q[1:], failed.run.error[1:], failed.run.events
        except SceneError as refused:
            wanted = refused.code in REFUSALS and holder not in ("", *COPIED, *HARMLESS)
            return replace(row, outcome=refused.code if wanted else "REFUSED")
        truth = Truth(twin)
        off = np.abs(q - truth.at(times)[-len(q) :]).max(axis=1)[-len(error) :]
        used = float((off[error > 0.0] / error[error > 0.0]).max())
        found = sum(event.kind == "ambiguous-tick" for event in events)
        return replace(row, outcome="WRONG" if used > 1.0 else "holds", worst=used, bar=float(error[-1]),
                       ambiguous=found, ticks=truth.ticks)  # fmt: skip
    except Exception as error:
        print(f"\n{number}: {type(error).__name__}: {error}")
        return replace(row, outcome="CRASH")


def solved_alone(scene: tl.Scene, twin: tl.Scene, number: int) -> Solved:
    """As a run."""
    asked: dict[str, Any] = {"accuracy": 10.0 ** -(5 + number % 7)}
    if number % 2:  # the bar alone, without what an accuracy adds to it
        asked = {"method": ("rk45", "dop853")[number // 2 % 2], "tolerance": 10.0 ** -(3 + number % 7)}
    run = tl.simulate(scene, t_eval=[float(t) for t in TIMES], patience=20.0, **asked)
    return twin, TIMES, run.q[1:], run.error[1:], run.events


def solved_as_world(scene: tl.Scene, twin: tl.Scene, number: int) -> Solved:
    """As the second of two worlds."""
    starts = np.array([scene.q + 0.4, scene.q])
    worlds = tl.simulate_many(scene, q=starts, v=np.array([scene.v, scene.v]), accuracy=10.0 ** -(5 + number % 5))
    return twin, TIMES, worlds.q[1:], worlds.error[1:], worlds.events[1] if worlds.events else ()


def solved_by_steps(scene: tl.Scene, twin: tl.Scene, number: int) -> Solved:
    """Step by step, after a motion that was broken off."""
    sim = tl.Simulation(scene, accuracy=10.0 ** -(5 + number % 5), verify=True)
    sim.step(float(SECONDS) / 2)
    sim.set_state(scene.q, scene.v, 0.0)
    for _ in range(5):
        sim.step(float(SECONDS) / 5)
    sim.restore(sim.save())
    return twin, TIMES, sim.state.q[None], np.array([sim.error]), sim.events


SOLVED: dict[str, Callable[[tl.Scene, tl.Scene, int], Solved]] = {
    "run": solved_alone, "world": solved_as_world, "steps": solved_by_steps,
}  # fmt: skip
WAYS = [*SOLVED]


def show(rows: list[Row], _: argparse.Namespace) -> Bars:
    """Print what came of the loops."""
    print(collections.Counter(row.outcome for row in rows))
    held = [row for row in rows if row.outcome == "holds"]
    ambiguous, used = sum(row.ambiguous > 0 for row in held), max((row.worst for row in held), default=0.0)
    ticks = sum(row.ticks for row in rows)
    print(f"{ticks:,} ticks, {ambiguous} loops with ambiguous ones; errors up to {used:.2f} bars")
    remembering = [row for row in rows if row.holder]
    print(f"of {len(remembering)} that remember something {sum(row.outcome == 'holds' for row in remembering)} hold, "
          f"{sum(row.outcome in REFUSALS for row in remembering)} are refused")  # fmt: skip
    for row in rows:
        if row.fails:
            print(f"{row.scene}: {row.outcome}, {row.holder}, {row.way}, {row.worst:.3g} bars")
    wrong, refused, crashed = (sum(row.outcome == what for row in rows) for what in ("WRONG", "REFUSED", "CRASH"))
    return [(wrong == 0, f"{wrong} bars are wrong"), (refused == 0, f"{refused} are refused that should not be"),
            (crashed == 0, f"{crashed} crashes")]  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "loops", Row, check, show))
