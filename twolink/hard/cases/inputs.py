"""Inputs that jump, torques that overflow a double, and very short and very long durations."""

from __future__ import annotations

import math

import numpy as np

from twolink.hard import truths

Array = np.ndarray


def _pieces(times: tuple[float, ...], forces: tuple[float, ...]) -> truths.ExactMotion:
    """1 kg from rest under a force [N] that is constant between times [s]: a parabola for each piece."""

    def exact(t: Array) -> Array:
        out = np.zeros(len(t))
        position = speed = 0.0
        for force, begin, length in zip(forces, times, np.diff(times, append=times[-1]), strict=True):
            s = t[t >= begin] - begin
            out[t >= begin] = position + speed * s + force * s * s / 2
            position, speed = position + speed * length + force * length**2 / 2, speed + force * length
        return out[:, None]

    return exact


SWING = truths.configuration_error(truths.swing(math.pi / 2, 9.81**0.5, -math.pi / 2))
ERRORS = {
    "short-pulse": truths.configuration_error(_pieces((5.0, 5.001), (1000.0, 0.0))),
    "torque-steps": truths.configuration_error(_pieces((0.0, 0.3, 0.7, 1.1), (1.0, -2.0, 5.0, 0.0))),
    "overflowing-torque": truths.configuration_error(lambda t: np.full((len(t), 2), np.inf)),
    "picosecond": SWING,
    "thirty-years": SWING,
}
