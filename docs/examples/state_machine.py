"""A state machine: a weak motor swings a pendulum up by its energy, and a second law catches it at the top.

The mode is the controller's state. It has a hysteresis: caught within 0.4 rad, given up beyond 0.8 rad.
"""

import numpy as np

import twolink as tl

fx = tl.effects
TOP = np.pi / 2  # the paper's arm is straight out at 0; its elbow is locked
LIMIT = 8.0  # N m: a quarter of what holds it straight out
CATCH, GIVE_UP = 0.4, 0.8  # rad
robot = tl.load_robot("two_link", lock={"elbow": 0.0})
level = sum(robot.energy([TOP], [0.0]))  # J, at rest at the top


def law(_, y, mode):
    """Torque [N m] and the next mode, "swing" or "catch"."""
    off = (y.q[0] - TOP + np.pi) % (2 * np.pi) - np.pi
    if mode == "swing" and abs(off) < CATCH and abs(y.v[0]) < 3.0:
        mode = "catch"
    elif mode == "catch" and abs(off) > GIVE_UP:
        mode = "swing"
    if mode == "catch":
        return [-60.0 * off - 20.0 * y.v[0]], mode
    return [2.0 * (level - sum(robot.energy(y.q, y.v))) * y.v[0]], mode


def scene() -> tl.Scene:
    """The pendulum hanging, nearly at rest."""
    control = fx.Controller(law, period=0.005, state="swing", limit={"shoulder": LIMIT})
    return tl.Scene(robot, [-TOP + 0.05], effects=[fx.Gravity(), control], duration=8.0, title="A state machine")


if __name__ == "__main__":
    run = tl.simulate(scene(), accuracy=1e-4)
    print(run, run.events)
    print("off at the end:", run.q[-1, 0] % (2 * np.pi) - TOP, "rad")
