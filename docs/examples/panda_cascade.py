"""Cascaded control of a geared motor in Panda's elbow: current at 4 kHz inside, speed and position at 1 kHz outside.

The controller gives the motor's voltage. It sees the current by a converter of 12 bits, and the motor's angle by an
encoder, through a stiff gear. The numbers of the drive are our choice, of the size of such joints.
"""

import numpy as np

import twolink as tl

fx = tl.effects
JOINT = "panda_joint4"
OTHERS = {f"panda_joint{i}": 0.0 for i in (1, 2, 3, 5, 6, 7)} | {f"panda_finger_joint{i}": 0.0 for i in (1, 2)}
FAST, EVERY = 1 / 4000, 4  # s; ticks of the current between two of the speed
RATIO, R, L, K, ROTOR = 100.0, 0.5, 1e-3, 0.08, 2e-5  # 1, ohm, H, N m/A, kg m^2
VOLTS, AMPERES = 48.0, 10.0
BAND = 2 * np.pi * 400  # of the current loop, rad/s
TARGET = -1.2  # rad
QUANTUM, CURRENT = 2 * np.pi / (4096 * RATIO), 2 * AMPERES / 4096  # of the joint's angle, and of the current


def cascade(_, y, state):
    """Voltage [V]. state: the tick, the reading before, wanted current, the integrals of current and speed."""
    tick, before, wanted, of_current, of_speed = state
    if tick % EVERY == 0:
        speed = (y.encoder[0] - before) / (EVERY * FAST)
        slow = np.clip(15.0 * (TARGET - y.encoder[0]), -1.0, 1.0) - speed
        free = 12.0 * slow + of_speed
        wanted, before = float(np.clip(free, -AMPERES, AMPERES)), y.encoder[0]
        of_speed += 60.0 * EVERY * FAST * slow if free == wanted else 0.0  # anti-windup
    error = wanted - y.current[0]
    of_current += R * BAND * FAST * error
    return [L * BAND * error + of_current], (tick + 1, before, wanted, of_current, of_speed)


def scene() -> tl.Scene:
    """Panda with its other joints locked; the elbow moves to its target under gravity."""
    start = -0.3
    control = fx.Controller(cascade, period=FAST, inputs=("encoder", "current"), limit={JOINT: VOLTS},
                            state=(0, start, 0.0, 0.0, 0.0))  # fmt: skip
    motor = fx.DCMotor(control, resistance={JOINT: R}, inductance={JOINT: L}, constant={JOINT: K})
    drive = fx.Gear(motor, {JOINT: RATIO}, inertia={JOINT: ROTOR})
    sensors = [fx.Encoder((JOINT,), period=FAST, quantum=QUANTUM),
               fx.StateSensor((f"{JOINT}.current",), name="current", period=FAST, quantum=CURRENT)]  # fmt: skip
    return tl.Scene(tl.load_robot("panda", lock=OTHERS), [start], effects=[fx.Gravity(), drive, *sensors],
                    duration=2.0, title="Cascaded control of Panda's elbow")  # fmt: skip


if __name__ == "__main__":
    run = tl.simulate(scene(), accuracy=1e-4)
    print(run, run.events)
    print("off at the end:", abs(run.q[-1, 0] - TARGET), "rad;", run.states[f"{JOINT}.current"][-1], "A")
