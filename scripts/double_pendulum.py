"""The chaotic double pendulum at t = 10 s: to 1e-9 in double precision, to 1e-20 in quadruple precision.

    python scripts/double_pendulum.py

Two equal uniform rods, released from rest at 90 degrees; errors of the start grow 10^5-fold. Double precision is
compared with published values. Quadruple precision goes from the URDF through Pinocchio's constants and our recursions,
and is compared with the hand-derived Lagrangian equations (twolink.lagrange.formulas) in numbers of 200 bits. The rods
have 3 kg, so that every constant of the equations, m L^2 / 12 among them, is a double exactly; the motion does not
depend on the common mass.
"""

from __future__ import annotations

import argparse
import time

import mpmath as mp
import numpy as np

import twolink as tl
from twolink.hard.high_precision import BITS, G, two_rods
from twolink.lagrange.pinocchio_arm import arm_urdf

SECONDS = 10.0
# th1, th2 absolute from downward; an independent program's, for g = 9.81.
PUBLISHED = (-0.74440708850904112, -14.345719734713967)


def main() -> None:
    """Print both comparisons."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    scene = tl.Scene(tl.load_robot(arm_urdf(1, 1, 3, 3)), effects=[tl.effects.Gravity((0.0, 0.0, -G))])
    tl.simulate(scene, SECONDS, accuracy=1e-9)  # compiles
    start = time.perf_counter()
    run = tl.simulate(scene, SECONDS, accuracy=1e-9)
    seconds = time.perf_counter() - start
    off = np.abs(np.cumsum(run.q[-1]) + np.pi / 2 - PUBLISHED).max()
    print(f"double: {off:.1e} rad from the published values, error bar {run.error[-1]:.1e}, {seconds:.2f} s")
    start = time.perf_counter()
    quad = tl.simulate(scene, SECONDS, accuracy=1e-20, precision="quad", samples=1)
    seconds = time.perf_counter() - start
    start = time.perf_counter()
    (by_hand,) = two_rods((3, 3), (0, 0), [SECONDS])
    by_hand_seconds = time.perf_counter() - start
    with mp.workprec(BITS):
        off = max(abs(mp.mpf(str(x)) - mp.mpf(y)) for x, y in zip(quad.precise[-1], by_hand, strict=False))
    print(f"quad:   {float(off):.1e} rad from the hand-derived equations in {BITS} bits, error bar "
          f"{quad.error[-1]:.1e}, {seconds:.1f} s (the {BITS} bits: {by_hand_seconds:.1f} s)")  # fmt: skip
    print(f"        theta1 = {quad.precise[-1][0]}")


if __name__ == "__main__":
    main()
