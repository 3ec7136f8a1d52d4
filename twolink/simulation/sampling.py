"""Duration and times of a run: sample times, and the times at which errors are looked at."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import array, instance, positive
from twolink.effects.inputs import SAME_TIME
from twolink.errors import SceneError
from twolink.scenes import Scene
from twolink.scenes.scene import duration_of

if TYPE_CHECKING:
    from twolink.simulation.trajectory import Trajectory

MAX_SAMPLES = 20_000_000
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def duration_for(scene: Scene, duration: float | None) -> float:
    """The duration [s] to simulate a scene for: the asked one, or its own. Raises SceneError for what is no scene."""
    own = instance(scene, Scene, "scene", SceneError).duration
    return own if duration is None else duration_of(duration)


def sample_times(
    duration: float, t_eval: ArrayLike | None, samples_per_second: float, limit: float = MAX_SAMPLES
) -> np.ndarray:
    """The times (n,) of samples up to the duration [s]: t_eval; without it 0, 1 / rate, 2 / rate, ... and the duration.

    Raises SceneError for more than `limit` of them (code "too-many-samples"), and for a t_eval that does not increase
    or is not within the run (code "times").
    """
    if t_eval is not None:
        return _checked_times(t_eval, duration, limit)
    rate = positive(samples_per_second, "samples_per_second", SceneError, "such as 200")
    if duration * rate > limit:
        raise SceneError(f"{duration * rate:.3g} samples, the limit is {limit:.0e}", argument="samples_per_second",
                         remedy="ask for fewer a second, or a shorter duration", code="too-many-samples")  # fmt: skip
    times = np.arange(max(1, math.ceil(duration * rate - 1e-9)) + 1) / rate
    times[-1] = duration
    return times if times[-2] < duration else np.append(times[times < duration], duration)


def _checked_times(t_eval: ArrayLike, duration: float, limit: float) -> np.ndarray:
    times = np.atleast_1d(array("t_eval", t_eval, None))
    if times.ndim > 1 or not times.size or (np.diff(times) <= 0.0).any():
        raise SceneError("expected times that increase", argument="t_eval", code="times",
                         remedy="such as np.linspace(0, duration, 101)")  # fmt: skip
    if times[0] < 0.0 or times[-1] > duration * (1.0 + SAME_TIME):
        raise SceneError(f"{times[0]:g} to {times[-1]:g} s are not within 0 and {duration:g} s", argument="t_eval",
                         remedy="ask for times of the run, or a longer duration", code="times")  # fmt: skip
    if len(times) > limit:
        raise SceneError(f"{len(times):.3g} samples, the limit is {limit:.0e}", argument="t_eval",
                         remedy="ask for fewer", code="too-many-samples")  # fmt: skip
    return np.asarray(np.minimum(times, duration))


def with_ends(times: np.ndarray, duration: float) -> np.ndarray:
    """The times (n,), and 0 and the duration [s] where they are not among them."""
    return times if len(times) > 1 and times[0] == 0.0 and times[-1] == duration else np.union1d(times, [0.0, duration])


def only_at(run: Trajectory, times: np.ndarray, duration: float) -> Trajectory:
    """The run with its samples at these times (n,) only, and where it ended before the duration [s]."""
    if len(run.t) == len(times) and run.t[-1] == times[-1]:  # its times are these and both ends
        return run
    kept = np.isin(run.t, times)
    kept[-1] |= run.t[-1] < duration
    if kept.all():
        return run
    parts = np.split(kept, np.cumsum([count for _, count in run.robots])[:-1]) if run.robots else ()
    robots = [(robot, int(part.sum())) for (robot, _), part in zip(run.robots, parts, strict=True)]
    error, precise = (None if rows is None else rows[kept] for rows in (run.error, run.precise))
    states = {name: values[kept] for name, values in run.states.items()}
    return replace(
        run, t=run.t[kept], q=run.q[kept], v=run.v[kept], error=error, precise=precise, robots=robots, states=states
    )


def with_check_times(times: np.ndarray, count: int) -> np.ndarray:
    """The times (n,), and others between them where n < count: one difference of two solutions may vanish by chance."""
    return times if len(times) >= count else np.union1d(times, np.linspace(times[0], times[-1], count))


def spread_out(n: int, count: int) -> np.ndarray:
    """Numbers from 0 to n - 1, increasing: all, or the first, the last, and one in each of `count` equal ranges.

    The golden ratio spreads them within their ranges, so that no motion has the same phase at all of them.
    """
    if n <= count + 2:
        return np.arange(n)
    k = np.arange(count)
    numbers = np.append(((k + k * GOLDEN % 1.0) * (n / count)).astype(int), n - 1)
    return np.asarray(numbers[np.append(numbers[1:] > numbers[:-1], True)])
