"""A pendulum on its head under PD control goes unstable at the delay that theory says.

Near its head x = (angle, velocity) follows x' = A x + B u. With the period T and the delay d = m T + r, 0 <= r < T,

    x_{k+1} = e^{A T} x_k + G(T - r) u_{k-m} + e^{A (T - r)} G(r) u_{k-m-1},    G(s) = int_0^s e^{A z} dz B,

is exact (Astrom, Wittenmark: Computer-Controlled Systems, 1997, section 2.3). The loop is stable while all eigenvalues
of this map are within the unit circle.
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import twolink as tl

fx = tl.effects
TOP = np.pi / 2  # the paper's arm is straight out at 0; its elbow is locked
PERIOD = 0.01
KP, KD = 120.0, 25.0


def pendulum() -> tl.Robot:
    """The paper's arm with a locked elbow."""
    return tl.load_robot("two_link", lock={"elbow": 0.0})


def pd(_, y, state):
    """Torque [N m] to the top."""
    return -KP * (y.q - TOP) - KD * y.v, state


def scene(delay: float, start: float = 1e-4) -> tl.Scene:
    """The pendulum at rest beside its top, under delayed control."""
    control = fx.Controller(pd, period=PERIOD, delay=delay)
    return tl.Scene(pendulum(), [TOP + start], effects=[fx.Gravity(), control], duration=4.0)


def step_map(delay: float) -> np.ndarray:
    """The map of (x_k, u_{k-1}, ..., u_{k-m-1}) to that of the next tick."""
    linear = tl.linearize(tl.Scene(pendulum(), effects=[fx.Gravity(), fx.Torque({"shoulder": 0.0})]), q=[TOP])
    whole = np.zeros((3, 3))  # e^{whole s} = [[e^{A s}, G(s)], [0, 1]]
    whole[:2] = np.hstack([linear.A, linear.B])
    m, r = divmod(delay, PERIOD)
    m, gain = int(m), np.array([-KP, -KD])
    late, early = expm(whole * r), expm(whole * (PERIOD - r))
    flow, newer, older = (early @ late)[:2, :2], early[:2, 2], early[:2, :2] @ late[:2, 2]
    size = 3 + m
    out = np.zeros((size, size))
    out[:2, :2] = flow
    out[:2, size - 1] = older
    if m == 0:
        out[:2, :2] += np.outer(newer, gain)
    else:
        out[:2, size - 2] = newer
    out[2, :2] = gain
    out[3:, 2:-1] = np.eye(m)
    return out


def growth(delay: float) -> float:
    """The largest |eigenvalue|: by how much the motion grows from tick to tick."""
    return float(np.abs(np.linalg.eigvals(step_map(delay))).max())


def longest_delay() -> float:
    """The delay at which the loop goes unstable, s."""
    return brentq(lambda delay: growth(delay) - 1.0, PERIOD, 0.5, xtol=1e-12)


if __name__ == "__main__":
    limit = longest_delay()
    print(f"stable below a delay of {1e3 * limit:.3f} ms")
    for share in (0.97, 1.03):
        run = tl.simulate(scene(share * limit), accuracy=1e-9)
        print(f"{share} of it: off by {abs(run.q[-200:] - TOP).max():.2g} rad after {run.t[-1]:g} s, began with 1e-4")
