"""Do the stated intervals hold? `tl.identify` and `tl.fit` on simulated measurements with noise, again and again.

    python -m scripts.studies.intervals [--scenes 100] [--seed 0] [--first 0] [--noise 0,1e-5] [--methods weighted]
        [--cases arm,panda,fit,twin,walk,panda-twin,panda-rest]

arm, panda: `tl.identify` from motions that are known exactly and torques with noise; also from positions alone, with a
noise of 1e-5 rad (an encoder of 19 bits). fit: `tl.fit` of an arm that falls with damping, from 3 s of joint angles
with a noise of 2e-3 rad. twin: the arm as a log has it: encoders of 16 bits alone, torques late by 8 ms, quantised,
with noise of 50 ms of memory and a steady drift; delay and offsets are looked for, the filter chosen. walk: the same
with an offset that walks at random, which the model does not have. panda-twin: a Panda's log like that, with friction
and steady drift; viscous and Coulomb friction, offsets and the delay are looked for. panda-rest: its motion stops three
times, where friction holds it with any torque within its size; all by default. A repetition asks which true values are
inside their 95 % intervals. Rows go to out/intervals-SEED.csv. Ends 0 if the share of each case is above
95 % less three standard deviations, as of repetitions whose intervals hold or fail together.
"""

import argparse
import functools
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

import twolink as tl
from scripts.runner import Bars, Some, Table, study
from scripts.tasks import robot_of
from twolink.scenes.parameters import scene_with

LATE, COUNT = 0.008, 2 * np.pi / 2**16  # s, rad
DRIVES = {"damping": 0.3, "friction": 0.4}  # of each joint of the Panda
NOISE = {"arm": 0.05, "panda": 0.1}  # N m
ANGLES = 2e-3  # rad: the noise of those that are fitted
TRUE = {"forearm.mass": 1.9, "effects.1.damping.elbow": 0.25, "effects.1.damping.shoulder": 0.4, "q.elbow": 0.72}


@dataclass(frozen=True)
class Row:
    """A repetition of a case. inside: 1 for each true value inside its interval, else 0. seconds: of the processor."""

    repetition: int
    case: str
    inside: str
    seconds: float


@functools.cache
def motion(robot: tl.Robot, n: int = 400, duration: float = 10.0, seed: int = 0) -> tuple[np.ndarray, ...]:
    """t, q, v, a of a Fourier series of five harmonics, and the torques."""
    rng = np.random.default_rng(seed)
    t, k = np.linspace(0, duration, n), 2 * np.pi / duration * np.arange(1, 6)[:, None]
    sines, cosines = rng.uniform(-0.5, 0.5, (2, 5, robot.nv))
    q = np.sin(k * t).T @ (sines / k) - np.cos(k * t).T @ (cosines / k)
    v = np.cos(k * t).T @ sines + np.sin(k * t).T @ cosines
    a = -np.sin(k * t).T @ (sines * k) + np.cos(k * t).T @ (cosines * k)
    return t, q, v, a, robot.inverse_dynamics(q, v, a)


def identified(name: str, shake: float, method: str, random: np.random.Generator) -> np.ndarray:
    """Which base parameters are inside their intervals."""
    robot = robot_of(name)
    t, q, v, a, tau = motion(robot)
    noisy = tau + NOISE[name] * random.standard_normal(tau.shape)
    seen, given = (q + shake * random.standard_normal(q.shape), {}) if shake else (q, {"a": a})
    found = tl.identify(robot, t, seen, None if shake else v, noisy, method=method, **given)
    return np.abs(found.estimate - found.matrix @ found.selection.nominal) <= found.half_width


def stopping(robot: tl.Robot, seed: int) -> tuple[np.ndarray, ...]:
    """As `motion`, along a time s(t) that stops three times."""
    t, phase = np.linspace(0, 10.0, 1500), 6 * np.pi * np.linspace(0, 1, 1500)
    rate = (1 + np.tanh(12 * (np.sin(phase) + 0.5))) / 2
    change = 3.6 * np.pi * (1 - (2 * rate - 1) ** 2) * np.cos(phase)
    s, (fine, *values, _) = cumulative_trapezoid(rate, t, initial=0.0), motion(robot, 40_001, seed=seed)
    q, v, a = (np.stack([np.interp(s, fine, x) for x in value.T], axis=1) for value in values)
    v, a = v * rate[:, None], a * rate[:, None] ** 2 + v * change[:, None]
    return t, q, v, a, robot.inverse_dynamics(q, v, a)


def recorded(
    name: str, random: np.random.Generator, walk: bool = False, seed: int = 0, rest: bool = False
) -> dict[str, np.ndarray]:
    """The log t, q, tau of a motion, as encoders of 16 bits and late, drifting, noisy, quantised torques have it."""
    robot = robot_of(name)
    t, q, v, _, tau = stopping(robot, seed) if rest else motion(robot, 1500, seed=seed)
    if name == "panda":
        hold, still = np.sign(v), np.abs(v).max(axis=1) < 1e-4
        for rows in np.split(np.arange(len(t)), np.flatnonzero(np.diff(still)) + 1):
            if still[rows[0]]:
                hold[rows] = random.uniform(-1, 1, robot.nv)
        tau = tau + DRIVES["damping"] * v + DRIVES["friction"] * hold
    colour = lfilter([1.0], [1.0, -np.exp(-(t[1] - t[0]) / 0.05)], random.standard_normal(tau.shape), axis=0)
    steps = random.standard_normal(tau.shape if walk else (1, robot.nv))
    drift = np.cumsum(steps, axis=0) / np.sqrt(len(t)) if walk else steps * (t / t[-1])[:, None]
    late = np.stack([np.interp(t - LATE, t, x) for x in tau.T], axis=1)
    log = np.round((late + 0.02 * colour + 0.02 * drift) / 0.005) * 0.005
    return {"t": t, "q": COUNT * np.round(q / COUNT), "tau": log}


def late_and_coloured(name: str, walk: bool, random: np.random.Generator, rest: bool = False) -> list[bool]:
    """Which base parameters, drives' parameters and the delay are inside their intervals."""
    model = "none" if walk else "viscous+coulomb+offset" if name == "panda" else "offset"
    given = {} if rest else {"find": ["delay"], "joint_model": model}
    found = tl.identify(robot_of(name), recorded(name, random, walk, rest=rest), **given)
    known = {"delay": LATE} | {f"{joint}.{kind}": value for joint in found.robot.joint_names if name == "panda"
                               for kind, value in DRIVES.items()}  # fmt: skip
    truth = [known.get(one, value) for one, value in zip(found.parameters, found.selection.nominal, strict=True)]
    inside = np.abs(found.estimate - found.matrix @ truth) <= found.half_width
    return [x for x, name in zip(inside.tolist(), found.combinations, strict=True) if not name.endswith(".offset")]


@functools.cache
def fall() -> tuple[tl.Scene, np.ndarray, np.ndarray]:
    """The guess, times, and true joint angles of an arm that falls."""
    effects = [tl.effects.Gravity(), tl.effects.JointDamping({"shoulder": 0.3, "elbow": 0.2})]
    robot, times = tl.load_robot("arm"), np.linspace(0.0, 3.0, 151)
    truth = scene_with(tl.Scene(robot, [1.0, TRUE["q.elbow"]], effects=effects),
                        {name: value for name, value in TRUE.items() if name != "q.elbow"})  # fmt: skip
    return tl.Scene(robot, [1.0, 0.7], effects=effects), times, tl.simulate(truth, 3.0, accuracy=1e-10).at(times)[0]


def fitted(random: np.random.Generator) -> list[bool]:
    """Which numbers of the scene are inside their intervals."""
    guess, times, q = fall()
    found = tl.fit(guess, {"t": times, "q": q + ANGLES * random.standard_normal(q.shape)}, list(TRUE))
    return [low <= TRUE[name] <= high for name, (low, high) in found.intervals.items()]


def rows_of(number: int, given: argparse.Namespace) -> Iterator[Row]:
    """A repetition of every case, all with the same random numbers."""
    calls = {f"{name}, {f'positions, {shake:g} rad' if shake else 'q, v, a'}, {method}":
             functools.partial(identified, name, shake, method) for name in given.cases if name in NOISE
             for shake in given.noise for method in given.methods}  # fmt: skip
    others = {"fit": fitted, "twin": functools.partial(late_and_coloured, "arm", False),
              "walk": functools.partial(late_and_coloured, "arm", True),
              "panda-twin": functools.partial(late_and_coloured, "panda", False),
              "panda-rest": functools.partial(late_and_coloured, "panda", False, rest=True)}  # fmt: skip
    calls |= {name: call for name, call in others.items() if name in given.cases}
    for case, call in calls.items():
        start = time.process_time()
        inside = call(np.random.default_rng(number + 1_000_000 * given.seed))
        yield Row(number, case, "".join("01"[bool(x)] for x in inside), round(time.process_time() - start, 3))


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The share of intervals that hold, of all values, and of the worst and the best."""
    bars, table = [], Table("case <40 | runs >5 | values >6 | inside >7.4f | worst >7.3f | best >7.3f | cpu s >7.3f")
    for case in dict.fromkeys(row.case for row in rows):
        some = [row for row in rows if row.case == case]
        marks = [[mark == "1" for mark in row.inside] for row in some]
        alike = len({*map(len, marks)}) == 1  # what is found by default differs from log to log: then by run
        each = np.mean(marks, axis=0) if alike else np.array([*map(np.mean, marks)])
        share = np.concatenate(marks).mean()
        table.add(case, len(some), len(each), share, each.min(), each.max(), np.mean([row.seconds for row in some]))
        least = 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(some))
        bars.append((share >= least, f"{case}: {share:.4f} (bar: {least:.4f})"))
    return bars


if __name__ == "__main__":
    cases = Some((*NOISE, "fit", "twin", "walk", "panda-twin", "panda-rest"))
    raise SystemExit(
        study(__doc__, "intervals", Row, rows_of, show, cases=cases, noise=(0.0, 1e-5), methods=("weighted",))
    )
