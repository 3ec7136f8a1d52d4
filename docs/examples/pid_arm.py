"""PID control of the paper's arm at 500 Hz, on encoders with 4,096 counts a turn, with a delay of 4 ms."""

import numpy as np

import twolink as tl

fx = tl.effects
TARGET = np.array([0.5, -0.3])
PERIOD = 0.002
KP, KI, KD = np.array([120.0, 60.0]), np.array([300.0, 150.0]), np.array([25.0, 8.0])


def pid(_, y, state):
    """Torques [N m] from encoder counts; the velocity is their difference. state: the reading before, the integral."""
    before, integral = state
    error, velocity = TARGET - y.encoder, (y.encoder - before) / PERIOD
    integral = integral + PERIOD * error
    return KP * error + KI * integral - KD * velocity, (y.encoder, integral)


def scene(delay: float = 0.004, seed: int = 7) -> tl.Scene:
    """The arm from rest, straight out, to its target."""
    robot = tl.load_robot("two_link")
    encoder = fx.Encoder(robot.joint_names, period=PERIOD, quantum=2 * np.pi / 4096, noise=2e-4, seed=seed)
    control = fx.Controller(pid, period=PERIOD, delay=delay, state=(np.zeros(2), np.zeros(2)), inputs=("encoder",))
    return tl.Scene(robot, effects=[fx.Gravity(), encoder, control], duration=3.0, title="PID, encoders and a delay")


if __name__ == "__main__":
    run = tl.simulate(scene(), accuracy=1e-4)
    print(run)
    print("off at the end:", abs(run.q[-1] - TARGET).max(), "rad")
