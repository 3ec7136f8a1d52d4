"""A controller at 1 kHz, beside MuJoCo's loop: seconds, errors, and what a tick costs.

python -m scripts.benchmarks.loop [--robot two_link,ur5,panda,solo12] [--law pd,cascade,predict] [--seconds 10]
                                  [--rate 1000] [--rounds 5]

Ours is verified, with its error bar: all three of its solutions see the controller. Its law is traced, or stays Python:
called once for all solutions where it takes rows, else for each. `alone` is one call of the law, which MuJoCo's time
contains once. MuJoCo steps once a tick (Euler, its default), from Python as its users do. The error is the largest
distance from a run by another method, DOP853 at a tolerance of 1e-13. Times are of the processor, the calls take turns.
Ends 0 if the Python law takes at most twice MuJoCo's time, and the traced one its time (of the arm) or 1.5 times, at a
thousandth of its error.

Solo falls on its four feet and stands under PD control in Python, for a tenth of the seconds: contacts are stepped, a
step a tick in both, and errors are those from rigid contact that is located, and
of MuJoCo, whose contact is soft, from its own limit of short steps too. What is asked of it is less error.
"""

import itertools
import time
from collections.abc import Callable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

import twolink as tl
from scripts.mujoco_world import MujocoWorld
from scripts.runner import FINGERS, Some, Table, options, print_bars, seconds_of
from scripts.tasks import GAINS, on_feet

Law = Callable[[float, Any, Any], tuple[np.ndarray, Any]]
KP, KD = 30.0, 8.0


def pd(_: float, y: Any, state: Any) -> tuple[np.ndarray, Any]:
    """The torques of a PD controller to 0.3 rad."""
    return KP * (0.3 - y.q) - KD * y.v, state


def no_state(_: int) -> None:
    """Nothing to remember."""


def cascade(t: float, y: Any, state: Any) -> tuple[np.ndarray, Any]:
    """Position above speed with an integral, limited, on a sine."""
    speed = np.clip(4.0 * (0.3 * np.sin(t) - y.q), -2.0, 2.0)
    state = np.clip(state + 0.001 * (speed - y.v), -0.5, 0.5)
    return np.clip(8.0 * (speed - y.v) + 10.0 * state, -80.0, 80.0), state


def predict(_: float, y: Any, state: Any) -> tuple[np.ndarray, Any]:
    """A gradient step of a plan of ten ticks for double integrators, whose first acts."""
    steps = np.arange(1.0, 11.0)[:, None]
    ahead = y.q + 0.05 * steps * y.v + 0.0025 * np.cumsum(np.cumsum(state, axis=0), axis=0)
    slope = np.flip(np.cumsum(np.flip(ahead - 0.3, axis=0), axis=0), axis=0)
    state = np.clip(0.95 * state - 2.0 * slope, -30.0, 30.0)
    return state[0] - 4.0 * y.v, state


LAWS: dict[str, tuple[Law, Callable[[int], Any]]] = {
    "pd": (pd, no_state), "cascade": (cascade, np.zeros), "predict": (predict, lambda n: np.zeros((10, n)))
}  # fmt: skip


def loops(name: str, seconds: float, rate: int, law: str = "pd", **fields: Any) -> tuple[tl.Scene, tl.Scene]:
    """The scene with the controller, and without."""
    robot = tl.load_robot(name, lock=FINGERS if name == "panda" else None)
    update, state = LAWS[law]
    control = tl.effects.Controller(update, period=Fraction(1, rate), state=state(robot.nv), **fields)
    bare = tl.Scene(robot, q=robot.normalize(robot.neutral), effects=[tl.effects.Gravity()], duration=seconds)
    return bare.with_effects([*bare.effects, control]), bare


def by_mujoco(scene: tl.Scene, law: tuple[Law, Callable[[int], Any]], seconds: float, rate: int, parts: int = 1,
              free: int = 0) -> np.ndarray:  # fmt: skip
    """q at each tick (n, nq), in our order. parts: steps of a tick; free: degrees of freedom without a motor."""
    world, count = MujocoWorld(scene, 1.0 / rate / parts), round(seconds * rate) + 1
    data, (update, start) = world.data, law
    q, v = np.empty((count, world.model.nq)), np.empty((count, world.model.nv))
    q[0], v[0], y = data.qpos, data.qvel, SimpleNamespace(q=data.qpos, v=data.qvel)
    state = start(world.model.nv)
    for k in range(1, count):
        data.qfrc_applied[free:], state = update((k - 1) / rate, y, state)
        mujoco.mj_step(world.model, data, parts)
        q[k], v[k] = data.qpos, data.qvel
    return world.ours(q, v)


def quadruped(seconds: float, rate: int, rounds: int) -> list[tuple[bool, str]]:
    """Solo under PD control in Python: rows and bars."""
    robot, q, target, contact = on_feet("solo12")
    aim, (kp, kd) = np.array([*target.values()]), GAINS["solo12"]
    bare = tl.Scene(robot, q, effects=[tl.effects.Gravity(), contact], duration=seconds)

    def stand(_: float, y: Any, state: Any) -> tuple[np.ndarray, Any]:
        return kp * (aim - y.q[7:]) - kd * y.v[6:], state

    control = tl.effects.Controller(stand, period=Fraction(1, rate), outputs=tuple(target))
    scene, times = bare.with_effects([*bare.effects, control]), np.linspace(0.0, seconds, round(seconds * rate) + 1)
    exact = tl.simulate(scene, contact="located", tolerance=1e-9, method="dop853", t_eval=times, verify=False).q
    found = dict[Any, Any]()

    def ours(*, verify: bool = True) -> None:
        found[verify] = tl.simulate(scene, contact="stepped", step=1.0 / rate, t_eval=times, verify=verify)

    def theirs() -> None:
        found["q"] = by_mujoco(bare, (stand, no_state), seconds, rate, free=6)

    taken = seconds_of(theirs, ours, lambda: ours(verify=False), rounds=rounds, warm_up=2, clock=time.process_time)
    soft = by_mujoco(bare, (stand, no_state), seconds, rate, 50, free=6)
    off = ((found["q"], exact), (found["q"], soft), (found[False].q, exact))
    errors = [float(np.abs(robot.difference(a, b)).max()) for a, b in off]
    table = Table("Solo <9 | MuJoCo us a tick >10.1f | with estimate >8.1f | one run >8.1f | MuJoCo's error >10.1e | "
                  "from its limit >9.1e | our error >9.1e | estimate >9.1e")  # fmt: skip
    table.add("solo12", *(1e6 * one / (seconds * rate) for one in taken), *errors, found[True].error[-1])
    slower = taken[2] / taken[0]
    more = f"{errors[0] / errors[2]:.2g} times less error, {slower:.2f} times the time"
    return [(errors[2] < errors[0], f"solo12: {more}")]


def main() -> None:
    given = options(__doc__, robot=Some(("two_link", "ur5", "panda", "solo12")), law=Some(tuple(LAWS)), seconds=10.0,
                    rate=1000, rounds=5)  # fmt: skip
    table = Table("robot <9 | law <8 | MuJoCo us a tick >10.1f | alone >5.1f | traced >8.1f | Python >8.1f | "
                  "traced, not verified >8.1f | MuJoCo's error >10.1e | our error >9.1e | error bar >9.1e")  # fmt: skip
    bars = []
    for name, law in itertools.product((one for one in given.robot if one != "solo12"), given.law):
        bare, ticks, found = loops(name, given.seconds, given.rate)[1], given.seconds * given.rate, dict[Any, Any]()
        scenes = {one: loops(name, given.seconds, given.rate, law, traced=one)[0] for one in (True, False)}

        def ours(traced: bool, scenes: dict = scenes, found: dict = found, *, verify: bool = True) -> None:
            found[traced] = tl.simulate(scenes[traced], samples_per_second=given.rate, verify=verify)

        def theirs(bare: tl.Scene = bare, found: dict = found, law: str = law) -> None:
            found["q"] = by_mujoco(bare, LAWS[law], given.seconds, given.rate)

        def calls(ticks: int = round(ticks), bare: tl.Scene = bare, law: str = law) -> None:
            (update, start), y = LAWS[law], SimpleNamespace(q=bare.q, v=bare.v)
            state = start(len(bare.v))
            for _ in range(ticks):
                update(0.0, y, state)

        taken = seconds_of(theirs, calls, lambda ours=ours: ours(True, verify=False), lambda ours=ours: ours(True),
                           lambda ours=ours: ours(False), rounds=given.rounds, clock=time.process_time)  # fmt: skip
        exact = tl.simulate(scenes[False], method="dop853", tolerance=1e-13, samples_per_second=given.rate,
                            verify=False).q  # fmt: skip
        errors = [float(np.abs(q - exact).max()) for q in (found["q"], found[True].q)]
        each = [1e6 * taken[k] / ticks for k in (0, 1, 3, 4, 2)]
        table.add(name, law, *each, *errors, found[True].error[-1])
        better, of = errors[0] / max(errors[1], 1e-16), f"{name}, {law}: "
        most = 1.0 if name == "two_link" else 1.5
        bars += [(each[2] <= most * each[0], f"{of}traced {each[2] / each[0]:.2f} times MuJoCo's time"),
                 (each[3] <= 2.0 * each[0], f"{of}Python {each[3] / each[0]:.2f} times MuJoCo's time"),
                 (better >= 1e3, f"{of}{better:.0e} times less error")]  # fmt: skip
    if "solo12" in given.robot:
        bars += quadruped(0.1 * given.seconds, given.rate, given.rounds)
    raise SystemExit(0 if print_bars(bars) else 1)


if __name__ == "__main__":
    main()
