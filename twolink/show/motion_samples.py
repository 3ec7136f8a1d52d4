"""The samples of a motion: checked, and interpolated at other times."""

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from twolink.errors import ShowError

Floats = NDArray[np.float64]


def check_motion(model: Any, t: ArrayLike, q: ArrayLike, speed: float) -> tuple[Floats, Floats]:
    """Check the samples of a motion.

    Parameters
    ----------
    model : pin.Model
        The robot.
    t : array_like (n,)
        Times in s, increasing.
    q : array_like (n, nq)
        Configurations.
    speed : float
        Simulated seconds per second of playing, above 0.

    Returns
    -------
    t : array (n,)
    q : array (n, nq)

    Raises
    ------
    ShowError
        When shapes do not match, a number is not finite, or t does not increase.
    """
    times, configurations = np.atleast_1d(np.asarray(t, float)), np.atleast_2d(np.asarray(q, float))
    if configurations.shape != (*times.shape, model.nq) or not len(times):
        expected = f"(n,) and (n, {model.nq}), n >= 1"
        what = f"t is {times.shape} and q is {configurations.shape}, expected {expected}"
        raise ShowError(what, where="playback", remedy="give one configuration for each time", argument="q")
    for name, values in (("t", times), ("q", configurations)):
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            remedy = "show the part before it" if row else "nothing before it can be shown"
            raise ShowError(f"{name} is not finite at sample {row}", where="playback", remedy=remedy, argument=name)
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        what = f"t does not increase at sample {row} ({times[row - 1]:g} s, then {times[row]:g} s)"
        raise ShowError(what, where="playback", remedy="sort the samples and drop repeated times", argument="t")
    if not (np.isfinite(speed) and speed > 0.0):
        what = f"speed is {speed}, expected a number above 0"
        raise ShowError(what, where="playback", remedy="1 is true speed", argument="speed")
    return times, configurations


def time_digits(shown: Floats) -> int:
    """Digits after the point that tell apart the times shown (n,), s; at least 2."""
    span = float(np.ptp(shown))
    return max(2, math.ceil(2.0 - math.log10(span))) if span else 2


def usual_speed(seconds: float) -> float:
    """The speed at which to play a motion of so many seconds: 1, and for one below 1 s less, so that it takes 2 to 5 s.

    That is 1, 2 or 5 times a power of ten.
    """
    if not 0.0 < seconds < 1.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(seconds / 2.0))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= seconds / 2.0)


def resample(model: Any, t: Floats, q: Floats, at: Floats) -> Floats:
    """Interpolate configurations on the manifold.

    Parameters
    ----------
    model : pin.Model
        The robot.
    t, q : array (n,), (n, nq)
        The samples; t in s, increasing.
    at : array (m,)
        Times in s. Before the first sample and after the last one the motion stands still.

    Returns
    -------
    array (m, nq)
    """
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    if len(t) == 1:
        return np.repeat(q, len(at), axis=0)
    share = np.clip((at - t[left]) / (t[left + 1] - t[left]), 0.0, 1.0)
    # Quaternions from a file with few digits are not quite of unit length, so normalise what is interpolated.
    unit = {i: pin.normalize(model, q[i]) for i in {*left.tolist(), *(left + 1).tolist()}}
    return np.array(
        [pin.interpolate(model, unit[i], unit[i + 1], s) for i, s in zip(left.tolist(), share, strict=True)]
    )
