"""Are answers about arms against their stops ever wrong in silence? Random arms, each simulated and judged.

    python -m scripts.studies.stops [--scenes 120] [--seed 0] [--first 0]

Arms of 2 to 6 joints with stops near the start, restitution 0 to 0.9, damping, dry friction, drives with limits of
effort, at accuracies of 1e-9 to 1e-3. Every answer has passed its certificate of laws, and its error bar must hold
beside an answer at a hundredth of the accuracy. The second way knows no events: Moreau's time stepping over
Pinocchio's M and h, with impulses of stops and friction by projected Gauss-Seidel, of steps h and h / 2. Where these
two agree, the answer must agree with them, or with steps 25 times smaller.

agrees; apart: the two steps differ too much to judge (impacts that hinge on less than the steps show); WRONG: the
steps agree, and the answer is elsewhere, or its bar is too small; refused: a named error, by code; CRASH: any other
error. Rows go to out/stops-SEED.csv. Ends 0 if no answer is wrong and nothing crashes.
"""

import argparse
import collections
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.runner import Bars, Judged, study
from scripts.studies.scenes.robots import random_urdf
from twolink import effects as fx

BLOCK = 6  # scenes that share an arm and its effects
SIZES = {2: 0.4, 3: 0.3, 4: 0.2, 6: 0.1}
KINDS = {"revolute": 0.8, "prismatic": 0.2}
STEP = 2e-4  # s, the larger of the two
FINER = 25  # smaller steps, where the answer is elsewhere: two impacts within one step count as one
APART = 0.02  # rad or m: two steps that differ by more say nothing
WITHIN, LEAST = 6.0, 1e-4  # an answer may differ from the finer steps by so many times what these differ, and so much
SWEEPS = 60


@dataclass(frozen=True)
class Arm:
    """A robot with its effects' numbers, by joint (nv,)."""

    robot: tl.Robot
    lower: np.ndarray
    upper: np.ndarray
    restitution: float
    damping: np.ndarray
    friction: np.ndarray
    drive: np.ndarray  # stiffness of a PD, 0 without
    effort: float

    def scene(self, q: np.ndarray, v: np.ndarray, duration: float) -> tl.Scene:
        def by_joint(values: np.ndarray) -> dict[str, float]:
            return dict(zip(self.robot.joint_names, values.tolist(), strict=True))

        limits = by_joint(np.stack([self.lower, self.upper], axis=1))
        effects = [fx.Gravity(), fx.JointStops({name: tuple(x) for name, x in limits.items()}, self.restitution)]
        effects += [kind(by_joint(numbers)) for kind, numbers in
                    ((fx.JointDamping, self.damping), (fx.DryFriction, self.friction)) if numbers.any()]  # fmt: skip
        if self.drive.any():
            effects.append(fx.JointPD(by_joint(0.0 * q), by_joint(self.drive), by_joint(0.05 * self.drive),
                                      effort=by_joint(self.effort + 0.0 * q)))  # fmt: skip
        return tl.Scene(self.robot, q, v, effects=effects, duration=duration)


def arm(random: np.random.Generator) -> Arm:
    """A random arm, whose stops lie around 0."""
    joints = int(random.choice(list(SIZES), p=list(SIZES.values())))
    robot = tl.load_robot(random_urdf(random, joints, base=False, kinds=KINDS)[0])
    some = random.random(3) < (0.6, 0.5, 0.3)
    return Arm(robot, -random.uniform(0.02, 0.8, joints), random.uniform(0.02, 0.8, joints),
               float(random.choice([0.0, 0.0, 0.5, 0.9])), some[0] * random.uniform(0.02, 0.5, joints),
               some[1] * random.uniform(0.05, 3.0, joints), some[2] * random.uniform(2.0, 40.0, joints),
               float(random.uniform(0.5, 5.0)))  # fmt: skip


def stepped(one: Arm, q: np.ndarray, v: np.ndarray, duration: float, step: float, times: np.ndarray) -> np.ndarray:
    """Configurations (n, nq) at times by Moreau's time stepping."""
    model, data = one.robot.model.copy(), one.robot.model.createData()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    q, v, out, count = q.copy(), v.copy(), [], round(duration / step)
    looks = set(np.round(times / step).astype(int).tolist())
    for n in range(count + 1):
        if n in looks:
            out.append(q.copy())
        middle = q + 0.5 * step * v
        mass, h = pin.crba(model, data, middle), pin.rnea(model, data, middle, v, np.zeros_like(v))
        mass = np.triu(mass) + np.triu(mass, 1).T
        torque = -h - one.damping * v
        if one.drive.any():
            torque += np.clip(-one.drive * middle - 0.05 * one.drive * v, -one.effort, one.effort)
        inverse = np.linalg.inv(mass)
        free = v + step * inverse @ torque
        low, high = middle <= one.lower, middle >= one.upper
        wanted = np.where(low, np.maximum(0.0, -one.restitution * v), np.where(high, np.minimum(
            0.0, -one.restitution * v), 0.0))  # fmt: skip
        v = _with_impulses(free, inverse, wanted, low, high, step * one.friction)
        q = middle + 0.5 * step * v
    return np.array(out)


def _with_impulses(free: np.ndarray, inverse: np.ndarray, wanted: np.ndarray, low: np.ndarray, high: np.ndarray,
                   friction: np.ndarray) -> np.ndarray:  # fmt: skip
    """Velocities after impulses of stops and of friction, which may hold."""
    v, stops, holds = free.copy(), np.zeros_like(free), np.zeros_like(free)
    for _ in range(SWEEPS if low.any() or high.any() or friction.any() else 0):
        before = v.copy()
        for k in range(len(v)):
            new = np.clip(holds[k] - v[k] / inverse[k, k], -friction[k], friction[k])
            v, holds[k] = v + inverse[k] * (new - holds[k]), new
            if low[k] or high[k]:
                new = stops[k] + (wanted[k] - v[k]) / inverse[k, k]
                new = max(new, 0.0) if low[k] else min(new, 0.0)
                v, stops[k] = v + inverse[k] * (new - stops[k]), new
        if np.abs(v - before).max() < 1e-12:
            break
    return v


def off_by_bars(scene: tl.Scene, run: tl.Trajectory, accuracy: float) -> float:
    """The largest error of a run by its bars, as a run of a smaller accuracy shows it; 0 where there is none."""
    try:
        finer = tl.simulate(scene, t_eval=run.t, accuracy=accuracy)
    except tl.errors.AccuracyError:
        return 0.0
    assert run.error is not None
    assert finer.error is not None
    off = np.abs(run.q - finer.q).max(axis=1) - finer.error
    return float((off / np.maximum(run.error, 1e-300)).max(where=off > 0.0, initial=0.0))


def check(number: int, given: argparse.Namespace) -> Judged:
    """The outcome of a scene, why, and how far the answer is from the finer steps, rad or m."""
    one = arm(np.random.default_rng([given.seed, number // BLOCK]))
    random = np.random.default_rng([given.seed, 1_000_000 + number])
    share = random.uniform(0.0, 1.0, one.robot.nq)
    share[random.random(one.robot.nq) < 0.2] = 0.0  # some begin at a stop
    q = one.lower + share * (one.upper - one.lower)
    v, duration = np.where(share > 0, random.normal(size=one.robot.nv), 0.0), float(random.integers(2, 11)) / 10
    scene, accuracy = one.scene(q, v, duration), 10.0 ** random.uniform(-9, -3)
    try:
        run = tl.simulate(scene, samples_per_second=50, accuracy=accuracy)
        beyond = off_by_bars(scene, run, 0.01 * accuracy)
    except tl.errors.TwolinkError as error:
        return Judged(number, outcome="refused", why=error.code)
    except Exception as error:  # a study counts what should not be
        return Judged(number, outcome="CRASH", why=repr(error))
    if beyond > 1.0:
        return Judged(number, outcome="WRONG", why=f"{len(run.events)} events, {accuracy:.1e}", worst=beyond)
    for step in (STEP, STEP / FINER):
        every = [stepped(one, q, v, duration, h, run.t) for h in (step, step / 2)]
        apart, away = (float(np.abs(a - b).max()) for a, b in ((every[0], every[1]), (run.q, every[1])))
        why = f"{len(run.events)} events, steps of {step:g} s {apart:.1e}"
        if apart > APART or away <= WITHIN * apart + LEAST:
            return Judged(number, outcome="apart" if apart > APART else "agrees", why=why, worst=away)
    return Judged(number, outcome="WRONG", why=why, worst=away)


def show(rows: list[Judged], _given: argparse.Namespace) -> Bars:
    """How often each outcome came."""
    print(dict(collections.Counter(row.outcome for row in rows)))
    bad, refused = sum(row.fails for row in rows), sum(row.outcome == "refused" for row in rows)
    return [(not bad, f"wrong in silence, crashes: {bad} of {len(rows)} (bar: none)"),
            (refused <= 0.05 * len(rows), f"refused: {refused} of {len(rows)} (bar: 5 %)")]  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "stops", Judged, check, show, scenes=120))
