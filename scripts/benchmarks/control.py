"""How accurate and how fast `linearize`, `lqr`, `equilibria` and `periodic_motion` are.

    python scripts/bench_control.py

A of robots under gravity is compared with Pinocchio's analytic derivatives (computeABADerivatives), which share no code
with it; the periodic motion of the paper's arm with a simulation of it in extended precision. Times are processor time.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.hard.extended_precision import extended_reference

E = tl.effects
STATES = 100  # of a motion


def timed(call: Callable[[], Any], repeats: int = 3) -> tuple[Any, float]:
    """The result, and the shortest processor time, ms."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        result = call()
        times.append(1e3 * (time.process_time() - begin))
    return result, min(times)


def linearizations() -> None:
    """Of the arm, the UR5 and the Panda at random states."""
    print("robot       bound on A  |A - Pinocchio|  |A|       one state   a state of a motion")
    for name in ("two_link", "ur5", "panda"):
        robot = tl.load_robot(name)
        scene = tl.Scene(robot, effects=[E.Gravity()])
        q, v = robot.random_state(STATES, seed=1)
        one, single = timed(lambda scene=scene, q=q, v=v: tl.linearize(scene, q[0], v[0]))
        _, many = timed(lambda scene=scene, q=q, v=v: tl.linearize(scene, q, v), 1)
        model, nv = scene.robot.model, robot.nv
        data = model.createData()
        theirs = np.concatenate(pin.computeABADerivatives(model, data, q[0], v[0], np.zeros(nv)), axis=1)
        ours = np.concatenate([one.A[nv:], one.B[nv:]], axis=1)
        off, size = np.abs(ours - theirs).max(), np.abs(theirs).max()
        print(f"{name:<11} {one.error:<11.1e} {off:<16.1e} {size:<9.2e} {single:6.1f} ms   {many / STATES:6.2f} ms")


def regulators() -> None:
    """Riccati's equation and the closed loop of the arm upright, with both motors and with one."""
    scene = tl.Scene(tl.load_robot("two_link"), [np.pi / 2, 0.0], effects=[E.Gravity()])
    print("\nmotors             time      slowest eigenvalue of the closed loop, 1/s")
    for inputs in (None, ["shoulder"], ["elbow"]):
        regulator, spent = timed(lambda inputs=inputs: tl.lqr(scene, 1.0, 0.1, inputs=inputs))
        closed = tl.linearize(scene.with_effects([*scene.effects, regulator]))
        value, error = closed.eigenvalues[0], closed.eigenvalue_errors[0]
        print(f"{', '.join(regulator.gain):<18} {spent:6.1f} ms  {value.real:.9g} +- {error:.1e}")


def motions() -> None:
    """The equilibria of the arm, and its cycle."""
    scene = tl.load_scene("arm-swing")
    found, spent = timed(lambda: tl.equilibria(scene), 1)
    print(f"\n{spent:.0f} ms\n{found}")
    cycle, spent = timed(lambda: tl.periodic_motion(scene, 2.5, ["q.elbow"]), 1)
    print(f"\n{spent:.0f} ms (with compiling)\n{cycle}")
    q, error = extended_reference(cycle.scene, np.array([0.0, cycle.period]))
    print(f"in extended precision the ends differ by {float(np.abs(q[-1] - q[0]).max()):.1e} +- {error[-1]:.1e} rad")


if __name__ == "__main__":
    linearizations()
    regulators()
    motions()
