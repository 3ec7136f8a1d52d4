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
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import twolink as tl
from scripts.runner import Bars, Judged, Table, study
from scripts.studies.scenes.robots import random_urdf
from twolink import effects as fx
from twolink.algorithms.mechanism import body_names
from twolink.hard.peers import peer_module
from twolink.hard.peers.task import Setting, task_of

TOLERANCE, LEAST = 1e-6, 1e-4  # rad or m: of the judge, and the least distance that a fault makes
TIGHT = {"scipy": Setting("DOP853", "", 1e-12), "mujoco": Setting("RK4", "", step=1e-4)}
END, GAP = 1.0, 0.01  # s
MAKERS = ["scipy", "mujoco", "twolink"]
Log = tuple[np.ndarray, np.ndarray, np.ndarray]
Made = tuple[tl.Scene, Any, str]
"""The scene that is judged, the log, and who made it."""


@dataclass
class Row(Judged):
    """A log, what made it, and the verdict. cause: "right", "other", "none", or "" of one that is not called wrong."""

    fault: bool = False
    cause: str = ""

    @property
    def fails(self) -> bool:
        return self.outcome in ("CRASH", "right" if self.fault else "wrong") or self.cause == "other"


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


def log_by(maker: str, scene: tl.Scene, gap: float = GAP, setting: Setting | None = None) -> Log:
    """The motion of a scene. setting: of a peer, tight by default."""
    times = gap * np.arange(round(scene.duration / gap) + 1)
    if maker == "twolink":
        run = tl.simulate(scene, float(times[-1]), accuracy=1e-9, t_eval=times)
        return run.t, run.q, run.v
    track = peer_module(maker).prepare(task_of(scene, times), setting or TIGHT[maker])().track
    return times, track.q, track.v


def other_body(random: np.random.Generator, scene: tl.Scene, draw: Callable[..., Any],
               made: Callable[..., Any]) -> tl.Scene:  # fmt: skip
    """One body has the inertia (mass, centre, moments) that is made of its own and of a number drawn at random."""
    body, value = int(random.integers(1, scene.base.model.njoints)), draw(random)

    def change(model: pin.Model) -> None:
        model.inertias[body] = pin.Inertia(*made(model.inertias[body], value))

    return tl.Scene(scene.base.changed(change), scene.q, scene.v, scene.effects, scene.duration)


def more_armature(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    def change(model: pin.Model) -> None:
        model.armature[int(random.integers(model.nv))] = random.uniform(0.02, 0.3)

    return tl.Scene(scene.base.changed(change), scene.q, scene.v, scene.effects, scene.duration)


def other_damping(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    damping = dict(scene.effects[1].damping)  # type: ignore[attr-defined]
    damping[str(random.choice(list(damping)))] += float(random.uniform(0.1, 1.0))
    return scene.with_effects([scene.effects[0], fx.JointDamping(damping)])


def rubbing(random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    friction = {name: float(random.uniform(0.05, 0.5)) for name in scene.base.joint_names}
    return scene.with_effects([*scene.effects, fx.DryFriction(friction)])


LAWS: dict[str, Callable[[np.random.Generator, tl.Scene], tl.Scene]] = {
    "mass": lambda random, scene: other_body(random, scene, lambda r: float(r.uniform(1.05, 1.5)), lambda one, factor: (
        factor * one.mass, one.lever, factor * one.inertia)),
    "inertia turned": lambda random, scene: other_body(
        random, scene, lambda r: pin.rpy.rpyToMatrix(*r.uniform(0.3, 1.5, 3)), lambda one, turn: (
            one.mass, one.lever, turn @ one.inertia @ turn.T)),
    "armature": more_armature,
    "gravity": lambda random, scene: scene.with_effects([
        fx.Gravity((0.0, 0.0, float(random.choice([-1.62, -9.78, -10.0, -3.7])))), *scene.effects[1:]]),
    "damping": other_damping,
    "damping left out": lambda _, scene: scene.with_effects(scene.effects[:1]),
    "friction": rubbing,
    "start": lambda random, scene: tl.Scene(scene.base, scene.q + random.uniform(0.01, 0.2, scene.base.nq), scene.v,
                                            scene.effects, END),
}  # fmt: skip
"""Faults that are another scene. On a joint's own body armature is an inertia."""


def law_fault(kind: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    maker = "twolink" if kind == "friction" else str(random.choice(MAKERS))
    other = LAWS[kind](random, scene)
    links = [name for body, name in enumerate(body_names(scene.base.model))
             if not scene.base.model.inertias[body].isApprox(other.base.model.inertias[body])]  # fmt: skip
    return scene, log_by(maker, other), ", ".join([maker, *links])


def stepped(method: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """Long steps: of MuJoCo, or written down here."""
    gap = float(random.choice([0.002, 0.004, 0.01]))
    times = gap * np.arange(round(END / gap) + 1)
    if method == "RK4":
        return scene, log_by("mujoco", scene, 0.05, Setting(method, "", step=0.05)), "mujoco"
    if method != "explicit Euler":
        setting = Setting(method, "", step=gap / int(random.choice([1, 2, 5])))
        return scene, log_by("mujoco", scene, gap, setting), "mujoco"
    rows, damping = [(scene.q, scene.v)], damping_of(scene)
    for _ in times[1:]:
        q, v = rows[-1]
        rows.append((q + gap * v, v + gap * scene.robot.forward_dynamics(q, v, -damping * v)))
    return scene, (times, *map(np.array, zip(*rows, strict=True))), "written down"


def damping_of(scene: tl.Scene) -> np.ndarray:
    return np.array(list(scene.effects[1].damping.values()))  # type: ignore[attr-defined]


def soft_friction(_: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    rubbed = rubbing(random, scene)
    return rubbed, log_by("mujoco", rubbed, 0.002, Setting("Euler", "", step=0.002)), "mujoco"


def wrong_sign(_: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """The Coriolis torque of one joint has the other sign."""
    robot, k, damping = scene.robot, int(random.integers(scene.robot.nv)), damping_of(scene)

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
    maker = str(random.choice(MAKERS))
    t, q, v = log_by(maker, scene)
    late = float(random.uniform(0.002, 0.05))
    log = {"degrees": (t, np.rad2deg(q), np.rad2deg(v)), "q in degrees": (t, np.rad2deg(q), v),
           "late": (t + late, q, v), "v late": (t[1:], q[1:], v[:-1]), "milliseconds": (1e3 * t, q, v)}  # fmt: skip
    return scene, log[kind], maker


FAULTS: dict[str, tuple[Callable[[str, np.random.Generator, tl.Scene], Made], tuple[str, ...]]] = {
    "mass": (law_fault, ("mass or inertia",)), "inertia turned": (law_fault, ("mass or inertia",)),
    "armature": (law_fault, ("armature differs", "mass or inertia")), "gravity": (law_fault, ("gravity differs",)),
    "damping": (law_fault, ("damping differs",)), "damping left out": (law_fault, ("damping is left out",)),
    "friction": (law_fault, ("friction",)), "start": (law_fault, ("starts elsewhere",)),
    "Euler": (stepped, ("implicit damping with steps",)), "implicitfast": (stepped, ("implicit damping with steps",)),
    "implicit": (stepped, ("implicit in the velocity",)), "RK4": (stepped, ("Runge-Kutta",)),
    "explicit Euler": (stepped, ("explicit Euler",)), "soft friction": (soft_friction, ("MuJoCo's soft friction",
    "MuJoCo's Euler")), "wrong sign": (wrong_sign, ()), "degrees": (spoilt, ("degrees",)),
    "q in degrees": (spoilt, ("q is in degrees",)), "late": (spoilt, ("late by",)), "v late": (spoilt, (
    "sample before",)), "milliseconds": (spoilt, ("milliseconds",)),
}  # fmt: skip
"""By kind: what makes the scene and its log, and words of the cause; none where no cause is to be named."""


def clean(kind: str, random: np.random.Generator, scene: tl.Scene) -> Made:
    """A log without a fault."""
    maker = str(random.choice(MAKERS))
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
    first = 20 * (kind == "from a late start")
    return scene, {"t": t, "q": q} if kind == "without velocities" else (t[first:], q[first:], v[first:]), maker


def _with_events(kind: str, random: np.random.Generator, scene: tl.Scene) -> tl.Scene:
    if kind == "sticking":
        return rubbing(random, scene)
    if kind != "impacts":
        made = tl.load_scene("box-stack" if kind == "boxes" else "panda-hold")
        return tl.Scene(made.base, made.q, made.v, made.effects, 0.2 if kind == "boxes" else 0.3)
    at = {joint.name: float(scene.q[joint.q.start]) for joint in scene.base.joints}
    stops = {name: (q - 0.3, q + 0.2) for name, q in at.items()}
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
        scene, log, maker = make(kind, random, arm(random))
        t, q, _ = log
        if kind in ("soft friction", "degrees", "milliseconds", "v late"):
            return kind, True, (scene, log, maker), words
        task = replace(task_of(scene, GAP * np.arange(3)), times=t)
        if np.abs(peer_module("scipy").prepare(task, TIGHT["scipy"])().track.q - q).max() > LEAST:
            break
    return kind, True, (scene, log, maker), words


def check(number: int, given: argparse.Namespace) -> Row:
    kind, fault, (scene, log, maker), words = made_of(number, given.seed)
    row = Row(number, kind, maker, fault=fault)
    begin = "log" if kind.startswith("from a") else "scene"
    try:
        verdict = tl.judge(scene, log, start=begin, tolerance=TOLERANCE, seconds=given.seconds)
    except Exception as error:  # a study counts what should not be
        return replace(row, outcome="CRASH", why=repr(error))
    causes = [cause.what for cause in verdict.causes]
    if kind in ("mass", "inertia turned"):
        words = (f"link {maker.rpartition(', ')[2]} differs",)
    named = any(word in cause for word in words for cause in causes)
    cause = "" if verdict.answer != "wrong" else "none" if not causes else "right" if named else "other"
    said = "; ".join(causes) or (str(verdict.nearest) if verdict.nearest else "")
    return replace(row, outcome=verdict.answer, cause=cause, why=said)


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The answers by kind, and how often the right cause is named."""
    for fault in (True, False):
        table = Table("kind <22 | logs >4 | right >5 | wrong >5 | not known >9 | cause right >11 | other >5 | none >4")
        for kind in dict.fromkeys(row.kind for row in rows if row.fault == fault):
            own = [row for row in rows if row.fault == fault and row.kind == kind]
            answers, causes = (collections.Counter(getattr(row, name) for row in own) for name in ("outcome", "cause"))
            said, named = ("right", "wrong", "not known"), ("right", "other", "none")
            table.add(kind, len(own), *(answers[x] for x in said), *(causes[x] for x in named))
        print()
    named, faults = sum(row.cause == "right" for row in rows if row.fault), sum(row.fault for row in rows)
    print(f"the right cause is named for {named} of {faults} faults; longest {max(r.seconds for r in rows):g} s")
    bad = sum(row.fails and row.cause != "other" for row in rows)
    other = sum(row.cause == "other" for row in rows)
    return [(not bad, f"wrong verdicts, crashes: {bad} of {len(rows)} (bar: none)"),
            (not other, f"wrong causes: {other} (bar: none)")]  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "referee", Row, check, show, scenes=120, seconds=20.0))
