"""The chaotic double pendulum at t = 10 s: to 1e-9 in double precision, to 1e-20 in quadruple precision.

Two equal uniform rods, released from rest at 90 degrees; errors of the start grow 10^5-fold. Double precision is held
against published values. Quadruple precision goes from the URDF through Pinocchio's constants and our recursions, and
is held against the hand-derived Lagrangian equations (twolink.lagrange.formulas) in numbers of 200 bits. The rods have
3 kg, so that every constant of the equations, m L^2 / 12 among them, is a double exactly; the motion does not depend
on the common mass.

    python scripts/double_pendulum.py
"""

from __future__ import annotations

import time
from typing import Any

import heyoka as hy
import numpy as np

import twolink as tl
from twolink.lagrange import formulas
from twolink.lagrange.pinocchio_arm import arm_urdf

SECONDS, BITS, G = 10, 200, 9.81
# th1, th2 absolute from downward; an independent program's, for g = 9.81.
PUBLISHED = (-0.74440708850904112, -14.345719734713967)


def exact(value: float) -> Any:
    """A double as a number of BITS bits."""
    return hy.expression(hy.real(value, BITS))


def by_hand() -> list[Any]:
    """theta1, theta2 at the end, by the hand-derived equations in BITS bits."""
    theta, rate = hy.make_vars("a", "b"), hy.make_vars("c", "d")
    lengths, masses = (exact(1.0), exact(1.0)), (exact(3.0), exact(3.0))
    a = formulas.mass_entries(lengths, masses, theta, hy)
    b = formulas.product_entries(lengths, masses, theta, hy)
    c = formulas.square_entries(lengths, masses, theta, hy, "corrected")
    d = formulas.gravity_entries(lengths, masses, exact(G), theta, hy)
    torque = [
        -(b[i][0] + b[i][1]) * (rate[0] * rate[1]) - c[i][0] * rate[0] ** 2 - c[i][1] * rate[1] ** 2 - d[i]
        for i in range(2)
    ]
    determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0]
    first = (a[1][1] * torque[0] - a[0][1] * torque[1]) / determinant
    second = (a[0][0] * torque[1] - a[1][0] * torque[0]) / determinant
    system = [(theta[0], rate[0]), (theta[1], rate[1]), (rate[0], first), (rate[1], second)]
    zero = hy.real(0, BITS)
    integrator = hy.taylor_adaptive(
        system, [zero] * 4, fp_type=hy.real, prec=BITS, tol=hy.real(1e-35, BITS), compact_mode=True
    )
    # Of exact symmetric rest the last coefficients may vanish: the first steps are short.
    integrator.propagate_until(hy.real(0.01, BITS), max_delta_t=hy.real(0.01, BITS))
    integrator.propagate_until(hy.real(SECONDS, BITS), max_delta_t=hy.real(0.1, BITS))
    return [integrator.state[0], integrator.state[1]]


def main() -> None:
    """Print both comparisons."""
    scene = tl.Scene(tl.load_robot(arm_urdf(1, 1, 3, 3)), effects=[tl.effects.Gravity((0.0, 0.0, -G))])
    tl.simulate(scene, SECONDS, accuracy=1e-9)
    start = time.perf_counter()
    run = tl.simulate(scene, SECONDS, accuracy=1e-9)
    seconds = time.perf_counter() - start
    absolute = (run.q[-1, 0] + np.pi / 2, run.q[-1].sum() + np.pi / 2)
    off = max(abs(x - y) for x, y in zip(absolute, PUBLISHED, strict=True))
    print(f"double: off the published values by {off:.1e} rad, error bar {run.error[-1]:.1e}, {seconds:.2f} s")
    start = time.perf_counter()
    quad = tl.simulate(scene, SECONDS, accuracy=1e-20, precision="quad", samples=1)
    seconds = time.perf_counter() - start
    start = time.perf_counter()
    hand = by_hand()
    by_hand_seconds = time.perf_counter() - start
    off = max(abs(float(hy.real(x, BITS) - y)) for x, y in zip(quad.precise[-1], hand, strict=False))
    print(f"quad:   off the hand-derived equations in {BITS} bits by {off:.1e} rad, error bar {quad.error[-1]:.1e}, "
          f"{seconds:.1f} s (the {BITS} bits: {by_hand_seconds:.1f} s)")  # fmt: skip
    print(f"        theta1 = {quad.precise[-1][0]}")


if __name__ == "__main__":
    main()
