"""What is asked of a run: scene, duration, sample times, and the times at which errors are looked at."""

import math

import numpy as np

from twolink.dynamics.arguments import positive
from twolink.errors import SceneError
from twolink.scenes import Scene
from twolink.scenes.scene import duration_of

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def duration_for(scene: Scene, duration: float | None) -> float:
    """The duration [s] to simulate a scene for: the asked one, or its own. Raises SceneError for what is no scene."""
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", where="scene", remedy="tl.load_scene(...)")
    return scene.duration if duration is None else duration_of(duration)


def sample_times(duration: float, samples: float, limit: float) -> np.ndarray:
    """The times 0, 1 / samples, 2 / samples, ... below the duration [s], and the duration itself.

    Raises SceneError for more than `limit` of them (code "too-many-samples").
    """
    rate = positive(samples, "samples", SceneError, "such as 200 a second")
    if duration * rate > limit:
        raise SceneError(
            f"{duration * rate:.3g} samples, the limit is {limit:.0e}",
            argument="samples",
            remedy="ask for fewer a second, or a shorter duration",
            code="too-many-samples",
        )
    times = np.arange(max(1, math.ceil(duration * rate - 1e-9)) + 1) / rate
    times[-1] = duration
    return times if times[-2] < duration else np.append(times[times < duration], duration)


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
