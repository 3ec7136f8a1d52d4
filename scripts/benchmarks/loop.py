"""A controller in plain Python at 1 kHz, beside MuJoCo's loop: seconds, errors, and what a tick costs.

python -m scripts.benchmarks.loop [--robot two_link,panda,solo12] [--seconds 10] [--rate 1000] [--rounds 5]

Ours is verified, with its error bar: each of its three solutions calls the controller. `law` is one such call alone,
which MuJoCo's time contains once and ours three times. MuJoCo steps once a tick (Euler, its default), from Python as
its users do. The error is the largest distance from a run by another method, DOP853 at a tolerance of 1e-13. Times are
of the processor, the calls take turns. Ends 0 if ours takes at most twice MuJoCo's time at a thousandth of its error.

Solo falls on its four feet and stands under PD control in Python, for a tenth of the seconds: contacts are stepped, a
step a tick in both, and errors are those from rigid contact that is located, and
of MuJoCo, whose contact is soft, from its own limit of short steps too. What is asked of it is less error.
"""

import time
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np

import twolink as tl
from scripts.benchmarks.contact import GAINS, on_feet
from scripts.runner import FINGERS, Some, Table, options, print_bars, seconds_of
from twolink.hard.peers import mujoco_peer
from twolink.hard.peers.task import from_peer, task_of, to_peer

KP, KD = 30.0, 8.0


def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The torques of a PD controller to 0.3 rad."""
    return KP * (0.3 - q) - KD * v


def loops(name: str, seconds: float, rate: int) -> tuple[tl.Scene, tl.Scene]:
    """The scene with the controller, and without."""
    robot = tl.load_robot(name, lock=FINGERS if name == "panda" else None)
    control = tl.effects.Controller(lambda _, y, state: (law(y.q, y.v), state), period=Fraction(1, rate))
    bare = tl.Scene(robot, q=robot.normalize(robot.neutral), effects=[tl.effects.Gravity()], duration=seconds)
    return bare.with_effects([*bare.effects, control]), bare


def by_mujoco(scene: tl.Scene, seconds: float, rate: int) -> np.ndarray:
    """q at the end of each step (n, nq)."""
    model = mujoco_peer.build(task_of(scene, np.array([0.0, seconds])))
    model.opt.timestep = 1.0 / rate
    data, q = mujoco.MjData(model), np.empty((round(seconds * rate) + 1, model.nq))
    data.qpos = q[0] = scene.q
    for k in range(1, len(q)):
        data.qfrc_applied[:] = law(data.qpos, data.qvel)
        mujoco.mj_step(model, data)
        q[k] = data.qpos
    return q


def on_feet_by_mujoco(scene: tl.Scene, control: Any, seconds: float, rate: int, parts: int = 1) -> np.ndarray:
    """q at each tick (n, nq), in our order; steps are parts of a tick."""
    task = task_of(scene, np.linspace(0.0, seconds, round(seconds * rate) + 1))
    model = mujoco_peer.build(task)
    model.opt.timestep = 1.0 / rate / parts
    data, q_at, v_at = mujoco.MjData(model), *mujoco_peer.columns(task, model)
    data.qpos[q_at], data.qvel[v_at] = to_peer(task, body_spin=True)
    q, v = np.empty((len(task.times), model.nq)), np.empty((len(task.times), model.nv))
    q[0], v[0] = data.qpos, data.qvel
    joints, driven = q_at[7:], v_at[6:]
    for k in range(1, len(q)):
        data.qfrc_applied[driven] = control(data.qpos[joints], data.qvel[driven])
        mujoco.mj_step(model, data, parts)
        q[k], v[k] = data.qpos, data.qvel
    return from_peer(task, q[:, q_at], v[:, v_at], body_spin=True).q


def quadruped(seconds: float, rate: int, rounds: int) -> list[tuple[bool, str]]:
    """Solo under PD control in Python: rows and bars."""
    robot, q, target, contact = on_feet("solo12")
    aim, (kp, kd) = np.array([*target.values()]), GAINS["solo12"]
    bare = tl.Scene(robot, q, effects=[tl.effects.Gravity(), contact], duration=seconds)

    def stand(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return kp * (aim - q) - kd * v

    control = tl.effects.Controller(lambda _, y, state: (stand(y.q[7:], y.v[6:]), state), period=Fraction(1, rate),
                                    outputs=tuple(target))  # fmt: skip
    scene, times = bare.with_effects([*bare.effects, control]), np.linspace(0.0, seconds, round(seconds * rate) + 1)
    exact = tl.simulate(scene, contact="located", tolerance=1e-9, method="dop853", t_eval=times, verify=False).q
    found = dict[Any, Any]()

    def ours(*, verify: bool = True) -> None:
        found[verify] = tl.simulate(scene, contact="stepped", step=1.0 / rate, t_eval=times, verify=verify)

    def theirs() -> None:
        found["q"] = on_feet_by_mujoco(bare, stand, seconds, rate)

    taken = seconds_of(theirs, ours, lambda: ours(verify=False), rounds=rounds, warm_up=2, clock=time.process_time)
    soft = on_feet_by_mujoco(bare, stand, seconds, rate, 50)
    off = ((found["q"], exact), (found["q"], soft), (found[False].q, exact))
    errors = [float(np.abs(robot.difference(a, b)).max()) for a, b in off]
    table = Table("Solo <9 | MuJoCo us a tick >10.1f | with estimate >8.1f | one run >8.1f | MuJoCo's error >10.1e | "
                  "from its limit >9.1e | our error >9.1e | estimate >9.1e")  # fmt: skip
    table.add("solo12", *(1e6 * one / (seconds * rate) for one in taken), *errors, found[True].error[-1])
    slower = taken[2] / taken[0]
    return [
        (errors[2] < errors[0], f"solo12: {errors[0] / errors[2]:.2g} times less error, {slower:.2f} times the time")
    ]


def main() -> None:
    given = options(__doc__, robot=Some(("two_link", "panda", "solo12")), seconds=10.0, rate=1000, rounds=5)
    table = Table("robot <9 | MuJoCo us a tick >10.1f | law >5.1f | ours >8.1f | not verified >8.1f | "
                  "MuJoCo's error >10.1e | our error >9.1e | error bar >9.1e")  # fmt: skip
    bars = []
    for name in (one for one in given.robot if one != "solo12"):
        scene, bare = loops(name, given.seconds, given.rate)
        ticks, found = given.seconds * given.rate, dict[Any, Any]()

        def ours(scene: tl.Scene = scene, found: dict = found, *, verify: bool = True) -> None:
            found[verify] = tl.simulate(scene, samples_per_second=given.rate, verify=verify)

        def theirs(bare: tl.Scene = bare, found: dict = found) -> None:
            found["q"] = by_mujoco(bare, given.seconds, given.rate)

        def calls(ticks: int = round(ticks), q: np.ndarray = bare.q, v: np.ndarray = bare.v) -> None:
            for _ in range(ticks):
                law(q, v)

        taken = seconds_of(theirs, calls, ours, lambda ours=ours: ours(verify=False), rounds=given.rounds,
                           clock=time.process_time)  # fmt: skip
        exact = tl.simulate(scene, method="dop853", tolerance=1e-13, samples_per_second=given.rate, verify=False).q
        errors = [float(np.abs(q - exact).max()) for q in (found["q"], found[True].q)]
        table.add(name, *(1e6 * one / ticks for one in taken), *errors, found[True].error[-1])
        slower, better = taken[2] / taken[0], errors[0] / max(errors[1], 1e-16)
        bars += [(slower <= 2.0, f"{name}: {slower:.2f} times MuJoCo's time"),
                 (better >= 1e3, f"{name}: {better:.0e} times less error")]  # fmt: skip
    if "solo12" in given.robot:
        bars += quadruped(0.1 * given.seconds, given.rate, given.rounds)
    raise SystemExit(0 if print_bars(bars) else 1)


if __name__ == "__main__":
    main()
