"""Is the referee ever wrong? Logs with a fault that was put in, and logs without one; judged by tl.judge.

    python -m scripts.studies.referee [--scenes 120] [--seed 0] [--first 0] [--seconds 20]

Random arms of 2 to 4 joints, and a UR5, under gravity with damping, for 1 s. Even scenes have a fault: another mass,
gravity, damping, dry friction or armature; an inertia that is rotated; degrees; a wrong sign in the equations; long
steps of several kinds; soft friction; late samples; another start; velocities of another sample. Odd scenes have none:
logs of few digits, without velocities, in single precision, from a start that is not told, of chaotic arms, of
motions with impacts and dry friction, of stacked boxes, of sampled controllers. The logs come from SciPy's DOP853 over
pin.aba (tolerance 1e-12), MuJoCo's RK4 at 0.1 ms, steps written down here, and twolink (accuracy 1e-9); of a fault the
distance from the true motion by SciPy is above 1e-4.

A verdict is wrong where a log with a fault is "right", or one without is "wrong". A cause is right where it is that of
the fault (or the motion does not tell them apart, and it says so); "other" where it is not: that is wrong too. Rows go
to out/referee-SEED.csv. Ends 0 if no verdict and no cause is wrong, and nothing crashes.
"""

import argparse
import collections
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import twolink as tl
from scripts.runner import Bars, Table, study
from scripts.studies.scenes.robots import random_urdf
from twolink import effects as fx
from twolink.algorithms.mechanism import body_names
from twolink.hard.peers import peer_module
from twolink.hard.peers.task import Setting, task_of

TOLERANCE, LEAST = 1e-6, 1e-4  # rad or m: of the judge, and the least distance that a fault makes
TIGHT = {"scipy": Setting("DOP853", "", 1e-12), "mujoco": Setting("RK4", "", step=1e-4)}
END, GAP = 1.0, 0.01  # s
Log = tuple[np.ndarray, np.ndarray, np.ndarray]
Made = tuple[tl.Scene, Any, str]
"""The scene that is judged, the log, and who made it."""


@dataclass(frozen=True)
class Row:
    """A log and its verdict. cause: "right", "other", "none", or "" of a log that is not called wrong."""

    scene: int
    kind: str
    maker: str
    fault: bool
    answer: str
    cause: str
    words: str
    seconds: float

    @property
    def fails(self) -> bool:
        return self.answer == ("right" if self.fault else "wrong") or self.answer == "CRASH" or self.cause == "other"


def arm(random: np.random.Generator) -> tl.Scene:
    """A random arm under gravity with damping, moving."""
    if random.random() < 0.15:
        robot = tl.load_robot("ur5")
    else:
        kinds = {"revolute": 0.8, "prismatic": 0.2}
        robot = tl.load_robot(random_urdf(random, int(random.integers(2, 5)), base=False, kinds=kinds)[0])
    damping = {name: float(random.uniform(0.05, 0.5)) for name in robot.joint_names}
    q, v = random.uniform(-1, 1, robot.nq), random.uniform(-1, 1, robot.nv)
    return tl.Scene(robot, q, v, [fx.Gravity(), fx.JointDamping(damping)], duration=END)


def log_by(maker: str, scene: tl.Scene, gap: float = GAP) -> Log:
    """The motion of a scene."""
    times = gap * np.arange(round(scene.duration / gap) + 1)
    if maker == "twolink":
        run = tl.simulate(scene, float(times[-1]), accuracy=1e-9, t_eval=times)
        return run.t, run.q, run.v
    track = peer_module(maker).prepare(task_of(scene, times), TIGHT[maker])().track
    return times, track.q, track.v


def changed(scene: tl.Scene, change: Callable[[pin.Model], None]) -> tl.Scene:
    return tl.Scene(scene.base.changed(change), scene.q, scene.v, scene.effects, scene.duration)


def body_of(random: np.random.Generator, scene: tl.Scene) -> int:
    return int(random.integers(1, scene.base.model.njoints))


def other_mass(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    body, factor = body_of(random, scene), float(random.uniform(1.05, 1.5))

    def change(model: pin.Model) -> None:
        one = model.inertias[body]
        model.inertias[body] = pin.Inertia(factor * one.mass, one.lever, factor * one.inertia)

    return changed(scene, change)


def turned_inertia(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    body, turn = body_of(random, scene), pin.rpy.rpyToMatrix(*random.uniform(0.3, 1.5, 3))

    def change(model: pin.Model) -> None:
        one = model.inertias[body]
        model.inertias[body] = pin.Inertia(one.mass, one.lever, turn @ one.inertia @ turn.T)

    return changed(scene, change)


def more_armature(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    def change(model: pin.Model) -> None:
        model.armature[int(random.integers(model.nv))] = random.uniform(0.02, 0.3)

    return changed(scene, change)


def other_gravity(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    field = (0.0, 0.0, float(random.choice([-1.62, -9.78, -10.0, -3.7])))
    return scene.with_effects([fx.Gravity(field), *scene.effects[1:]])


def other_damping(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    damping = dict(scene.effects[1].damping)  # type: ignore[attr-defined]
    damping[str(random.choice(list(damping)))] += float(random.uniform(0.1, 1.0))
    return scene.with_effects([scene.effects[0], fx.JointDamping(damping)])


def no_damping(_random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    return scene.with_effects(scene.effects[:1])


def rubbing(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    friction = {name: float(random.uniform(0.05, 0.5)) for name in scene.base.joint_names}
    return scene.with_effects([*scene.effects, fx.DryFriction(friction)])


def elsewhere(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    return tl.Scene(scene.base, scene.q + random.uniform(0.01, 0.2, scene.base.nq), scene.v, scene.effects, END)


Change = Callable[[np.random.Generator, tl.Scene], tl.Scene]
LAWS: dict[str, tuple[Change, tuple[str, ...]]] = {
    "mass": (other_mass, ("mass or inertia",)),
    "inertia turned": (turned_inertia, ("mass or inertia",)),
    "armature": (more_armature, ("armature differs", "mass or inertia")),
    "gravity": (other_gravity, ("gravity differs",)),
    "damping": (other_damping, ("damping differs",)),
    "damping left out": (no_damping, ("damping is left out",)),
    "friction": (rubbing, ("friction",)),
    "start": (elsewhere, ("starts elsewhere",)),
}
"""Faults that are another scene, and words of their cause. On a joint's own body armature is an inertia."""


def law_fault(kind: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    maker = "twolink" if kind == "friction" else str(random.choice(["scipy", "mujoco", "twolink"]))
    other = LAWS[kind][0](random, scene)
    links = [name for body, name in enumerate(body_names(scene.base.model))
             if not scene.base.model.inertias[body].isApprox(other.base.model.inertias[body])]  # fmt: skip
    return scene, log_by(maker, other), ", ".join([maker, *links])


def stepped(method: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """Long steps: of MuJoCo, or written down here."""
    gap = float(random.choice([0.002, 0.004, 0.01]))
    times = gap * np.arange(round(END / gap) + 1)
    if method != "explicit":
        step = gap / int(random.choice([1, 2, 5])) if method != "RK4" else 0.05
        times = times if method != "RK4" else 0.05 * np.arange(21)
        track = peer_module("mujoco").prepare(task_of(scene, times), Setting(method, "", step=step))().track
        return scene, (times, track.q, track.v), "mujoco"
    rows, damping = [(scene.q, scene.v)], np.array(list(scene.effects[1].damping.values()))  # type: ignore[attr-defined]
    for _ in times[1:]:
        q, v = rows[-1]
        a = scene.robot.forward_dynamics(q, v, -damping * v)
        rows.append((q + gap * v, v + gap * a))
    return scene, (times, np.array([q for q, _ in rows]), np.array([v for _, v in rows])), "written down"


def soft_friction(random: np.random.Generator, scene: tl.Scene) -> Made:
    rubbed = rubbing(random, scene)
    times = 0.002 * np.arange(501)
    track = peer_module("mujoco").prepare(task_of(rubbed, times), Setting("Euler", "", step=0.002))().track
    return rubbed, (times, track.q, track.v), "mujoco"


def wrong_sign(random: np.random.Generator, scene: tl.Scene) -> Made:
    """The Coriolis torque of one joint has the other sign."""
    robot, k = scene.robot, int(random.integers(scene.robot.nv))
    damping = np.array(list(scene.effects[1].damping.values()))  # type: ignore[attr-defined]

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[: robot.nq], x[robot.nq :]
        tau = -damping * v
        tau[k] += 2 * (robot.bias(q, v) - robot.gravity_torque(q))[k]
        return np.concatenate([v, robot.forward_dynamics(q, v, tau, engine="pinocchio")])

    times = GAP * np.arange(round(END / GAP) + 1)
    found = solve_ivp(rate, (0, END), np.concatenate([scene.q, scene.v]), "DOP853", times, rtol=1e-10, atol=1e-10)
    return scene, (found.t, found.y[: robot.nq].T, found.y[robot.nq :].T), "scipy"


def spoilt(kind: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """A right log whose numbers were written down wrongly."""
    maker = str(random.choice(["scipy", "mujoco", "twolink"]))
    t, q, v = log_by(maker, scene)
    late = float(random.uniform(0.002, 0.05))
    log = {"degrees": (t, np.rad2deg(q), np.rad2deg(v)), "q in degrees": (t, np.rad2deg(q), v),
           "late": (t + late, q, v), "v late": (t[1:], q[1:], v[:-1]), "milliseconds": (1e3 * t, q, v)}  # fmt: skip
    return scene, log[kind], maker


FAULTS: dict[str, tuple[Callable[[np.random.Generator, tl.Scene], Made], tuple[str, ...]]] = {
    **{kind: (lambda random, scene, kind=kind: law_fault(kind, random, scene), words)
       for kind, (_, words) in LAWS.items()},
    "Euler": (lambda random, scene: stepped("Euler", random, scene), ("implicit damping with steps",)),
    "implicitfast": (lambda random, scene: stepped("implicitfast", random, scene), ("implicit damping with steps",)),
    "implicit": (lambda random, scene: stepped("implicit", random, scene), ("implicit in the velocity",)),
    "RK4": (lambda random, scene: stepped("RK4", random, scene), ("Runge-Kutta",)),
    "explicit Euler": (lambda random, scene: stepped("explicit", random, scene), ("explicit Euler",)),
    "soft friction": (soft_friction, ("MuJoCo's soft friction", "MuJoCo's Euler")),
    "wrong sign": (wrong_sign, ()),
    "degrees": (lambda random, scene: spoilt("degrees", random, scene), ("degrees",)),
    "q in degrees": (lambda random, scene: spoilt("q in degrees", random, scene), ("q is in degrees",)),
    "late": (lambda random, scene: spoilt("late", random, scene), ("late by",)),
    "v late": (lambda random, scene: spoilt("v late", random, scene), ("sample before",)),
    "milliseconds": (lambda random, scene: spoilt("milliseconds", random, scene), ("milliseconds",)),
}  # fmt: skip
"""By kind: the scene and its log, and words of the cause; none where no cause is to be named."""


def clean(kind: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """A log without a fault."""
    maker = str(random.choice(["scipy", "mujoco", "twolink"]))
    if kind in ("impacts", "sticking", "boxes", "controller"):
        maker, scene = "twolink", _with_events(kind, random, scene)
    if kind == "chaotic":
        return _chaotic(random)
    t, q, v = log_by(maker, scene)
    digits = int(random.integers(2, 7))
    if kind in ("decimals", "from a rounded start"):
        q, v = np.round(q, digits), np.round(v, digits)
    elif kind == "significant digits":
        t, q, v = (np.array([float(f"{x:.{digits}g}") for x in y.flat]).reshape(y.shape) for y in (t, q, v))
    elif kind == "single precision":
        q, v = q.astype(np.float32).astype(float), v.astype(np.float32).astype(float)
    elif kind == "without velocities":
        return scene, {"t": t, "q": q}, maker
    elif kind == "from a late start":
        t, q, v = t[20:], q[20:], v[20:]
    return scene, (t, q, v), maker


def _with_events(kind: str, random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    if kind == "sticking":
        return rubbing(random, scene)
    if kind == "boxes":
        made = tl.load_scene("box-stack")
        return tl.Scene(made.base, made.q, made.v, made.effects, 0.2)
    if kind == "controller":
        made = tl.load_scene("panda-hold")
        return tl.Scene(made.base, made.q, made.v, made.effects, 0.3)
    stops = {joint.name: (float(scene.q[joint.q.start]) - 0.3, float(scene.q[joint.q.start]) + 0.2)
             for joint in scene.base.joints}  # fmt: skip
    return scene.with_effects([*scene.effects, fx.JointStops(stops, float(random.choice([0.0, 0.5])))])


def _chaotic(random: np.random.Generator) -> Made:
    """An arm that turns over and over, by 33 digits; the scene that is judged has stops far away, which leave 16."""
    two = tl.load_robot("two_link")
    free = tl.Scene(two, [np.pi / 2, float(random.uniform(0, 1))], [0.0, float(random.uniform(2, 4))], [fx.Gravity()],
                    duration=float(random.integers(12, 18)))  # fmt: skip
    stops = fx.JointStops(dict.fromkeys(two.joint_names, (-1e4, 1e4)))
    return free.with_effects([*free.effects, stops]), log_by("twolink", free, 0.05), "twolink"


CLEAN = ("plain", "decimals", "significant digits", "single precision", "without velocities", "from a rounded start",
         "from a late start", "chaotic", "impacts", "sticking", "boxes", "controller")  # fmt: skip


def made_of(number: int, seed: int) -> tuple[str, bool, Made, tuple[str, ...]]:
    """The kind, whether it is a fault, the log, and words of its cause."""
    random, place = np.random.default_rng([seed, number]), number // 2
    if number % 2:
        kind = CLEAN[place % len(CLEAN)]
        return kind, False, clean(kind, random, arm(random)), ()
    kind = list(FAULTS)[place % len(FAULTS)]
    make, words = FAULTS[kind]
    for _ in range(20):
        scene, log, maker = make(random, arm(random))
        t, q, _ = log
        if kind in ("soft friction", "degrees", "milliseconds", "v late"):
            return kind, True, (scene, log, maker), words
        task = replace(task_of(scene, GAP * np.arange(3)), times=t)
        if np.abs(peer_module("scipy").prepare(task, TIGHT["scipy"])().track.q - q).max() > LEAST:
            break
    return kind, True, (scene, log, maker), words


def check(number: int, given: argparse.Namespace) -> list[Row]:
    start = time.perf_counter()
    kind, fault, (scene, log, maker), words = made_of(number, given.seed)
    try:
        begin = "log" if kind.startswith("from a") else "scene"
        verdict = tl.judge(scene, log, start=begin, tolerance=TOLERANCE, seconds=given.seconds)
    except Exception as error:  # a study counts what should not be
        return [Row(number, kind, maker, fault, "CRASH", "", repr(error), round(time.perf_counter() - start, 1))]
    causes = [cause.what for cause in verdict.causes]
    if kind in ("mass", "inertia turned"):
        words = (f"link {maker.rpartition(', ')[2]} differs",)
    named = any(word in cause for word in words for cause in causes)
    cause = "" if verdict.answer != "wrong" else "none" if not causes else "right" if named else "other"
    text = "; ".join(causes) or (str(verdict.nearest) if verdict.nearest else "")
    return [Row(number, kind, maker, fault, verdict.answer, cause, text, round(time.perf_counter() - start, 1))]


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The answers by kind, and how often the right cause is named."""
    for fault in (True, False):
        table = Table("kind <22 | logs >4 | right >5 | wrong >5 | not known >9 | cause right >11 | other >5 | none >4")
        some = [row for row in rows if row.fault == fault]
        for kind in dict.fromkeys(row.kind for row in some):
            own = [row for row in some if row.kind == kind]
            answers, causes = (collections.Counter(getattr(row, name) for row in own) for name in ("answer", "cause"))
            table.add(kind, len(own), answers["right"], answers["wrong"], answers["not known"], causes["right"],
                      causes["other"], causes["none"])  # fmt: skip
        print()
    faults = [row for row in rows if row.fault]
    named = sum(row.cause == "right" for row in faults)
    print(f"the right cause is named for {named} of {len(faults)} faults; longest {max(r.seconds for r in rows):g} s")
    bad = sum(row.fails and row.cause != "other" for row in rows)
    other = sum(row.cause == "other" for row in rows)
    return [(not bad, f"wrong verdicts, crashes: {bad} of {len(rows)} (bar: none)"),
            (not other, f"wrong causes: {other} (bar: none)")]  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "referee", Row, check, show, scenes=120, seconds=20.0))
