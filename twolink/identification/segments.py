"""How a measured motion is cut into segments for multiple shooting, and where their starts are guessed."""

import math
from collections.abc import Sequence

import numpy as np

from twolink.errors import QueryError
from twolink.identification.differentiation import SMALLEST, smooth
from twolink.identification.measured_motion import MeasuredMotion
from twolink.identification.shooting import Shot, State
from twolink.integrate.scene_equations import equations_of
from twolink.scenes import Scene

GROWTH = 30.0  # of errors of a start within a segment
FEWEST = 4  # samples in a segment
UNKNOWN = 50  # samples in a segment, where the growth is not known
TRIED = (1, 4, 16)  # times as many segments, one after the other, until the motion is found


def can_be_cut(scene: Scene) -> bool:
    """Whether a motion may be simulated in segments."""
    equations = equations_of(scene)
    return equations.constraints is None and not equations.has_events


def segment_counts(asked: int | None, growth: float, data: MeasuredMotion, scene: Scene) -> list[int]:
    """The numbers of segments to try. growth: of errors of the start along the scene's motion.

    Raises QueryError for a number that cannot be.
    """
    most = max(1, len(data.t) // FEWEST)
    smooth_motion = can_be_cut(scene)
    if asked is not None:
        if isinstance(asked, bool) or not isinstance(asked, int) or not 1 <= asked <= most:
            raise QueryError(f"expected a whole number from 1 to {most}, got {asked!r}", argument="segments",
                             remedy=f"a segment has {FEWEST} samples at least")  # fmt: skip
        if asked > 1 and not smooth_motion:
            raise QueryError("motions with events or closed loops are simulated in one piece", argument="segments",
                             remedy="leave it out", code="one-segment")  # fmt: skip
        return [asked]
    if not smooth_motion:
        return [1]
    if math.isinf(growth):
        first = max(2, len(data.t) // UNKNOWN)
    else:
        first = 1 if growth < GROWTH**2 else math.ceil(math.log(growth) / math.log(GROWTH))
    return list(dict.fromkeys(min(most, first * factor) for factor in TRIED))


def segment_ends(count: int, data: MeasuredMotion) -> list[int]:
    """The numbers of the samples at which segments end, but the last."""
    times = np.linspace(0.0, float(data.t[-1]), count + 1)[1:-1]
    found = np.unique(np.searchsorted(data.t, times))
    return [int(number) for number in found if FEWEST - 1 <= number < len(data.t) - FEWEST]


def later_starts(ends: Sequence[int], data: MeasuredMotion, shot: Shot | None) -> list[State]:
    """States at the ends of segments: measured, filtered and differentiated; else of the first guess."""
    if not ends:
        return []
    robot, q, v = data.robot, data.q, data.v
    if shot is not None:
        q, v = (np.concatenate([getattr(segment, name) for segment in shot.segments]) for name in "qv")
    change = robot.difference(q, data.q)
    change[:, np.setdiff1d(np.arange(robot.nv), data.of_q)] = 0.0
    q = np.asarray(robot.integrate(q, change))
    if len(data.t) >= 2 * SMALLEST + 5:
        filtered = smooth(robot, data.t, q)
        inner = slice(filtered.half, len(q) - filtered.half)
        q[inner] = filtered.q
        v = v.copy()
        v[inner, data.of_q] = filtered.v[:, data.of_q]
    v[:, data.of_v] = data.v[:, data.of_v]
    return [(q[number], v[number]) for number in ends]
