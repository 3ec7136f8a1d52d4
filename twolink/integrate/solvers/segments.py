"""Pieces: solving equations from break to break, so that no step goes across what is not smooth."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Segment, Solution, joined


def in_segments(equations: Equations, times: Array, solve: Callable[[Equations, Array], Solution]) -> Solution:
    """Solve from break to break for the samples `times` (n,).

    Each segment is solved on its own by `solve(equations, times)`, from the state at its beginning.
    """
    start, end = float(times[0]), float(times[-1])
    equations.require(start, end)
    edges = [start, *(t for t in equations.breaks(end) if t > start), end]
    if len(edges) == 2 and not equations.layout.tables:
        return solve(equations, times)
    held = {name: equations.start[row] for name, row in equations.layout.rows_of_slots().items()}
    parts: list[Solution] = []
    x: Any = equations.start
    for begin, stop in itertools.pairwise(edges):
        grid, extra = segment_times(times, begin, stop)
        segment = equations.starting_at(x, 0.5 * (begin + stop), slots=held)
        part = solve(segment, grid)
        x = part.x[:, -1]
        taken = slice(int(bool(parts)), len(part.t) - int(extra and len(part.t) == len(grid)))
        parts.append(replace(part, t=part.t[taken], x=part.x[: equations.moving, taken],
                             segments=(Segment(segment, begin, len(part.t[taken])),),
                             precise=None if part.precise is None else part.precise[taken]))  # fmt: skip
        if part.interrupted:
            break
    return joined(parts)


def segment_times(times: Array, begin: float, stop: float) -> tuple[Array, bool]:
    """The begin of a segment, the samples within it and its end; and whether that end is no sample."""
    first, after = np.searchsorted(times, [begin, stop], side="right")
    inside = times[first:after]
    extra = not inside.size or bool(inside[-1] < stop)
    return np.concatenate([[begin], inside, [stop] if extra else []]), extra
