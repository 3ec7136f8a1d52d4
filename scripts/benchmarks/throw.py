"""The best throw by slopes, beside a grid of release times.

Both answer to the same accuracy. The grid's spacing must change the aim by no more than 1e-6 (by the second derivatives
that the search tells). A plain grid of that spacing is counted, not computed: one that zooms in around its best point
finds the same place with fewer runs, the fewest without slopes. Both counts are shown; the bar is of the plain one.

    python -m scripts.benchmarks.throw [--throws pitch,bowl] [--points 7] [--accuracy 1e-7]

Ends 0 if the search finds what the grid finds to 1e-6, with a tenth of the plain grid's runs.
"""

import itertools
import math
import time

import numpy as np

from scripts.runner import once, options, print_bars
from twolink.errors import TwolinkError
from twolink.paper.throw import AIMS, SearchResult, search, throw
from twolink.scenes import load_scene

NEAR = 1e-6  # m or m/s
SHARE = 0.1  # of the plain grid's runs
ZOOM = 1.0  # spacings on each side of the best point, that the next grid covers


def by_grid(found: SearchResult, points: int) -> tuple[float, dict[str, float], int, int]:
    """The best of zooming grids, its release times, the number of runs, and that of a plain grid that is as fine."""
    aim, scene = AIMS[found.name], load_scene(found.name)
    curvature = {name: abs(row[2]) for name, row in found.by_time.items()}
    windows, best, where, runs = dict(aim.windows), -np.inf, dict[str, float](), 0
    while True:
        axes = {name: np.linspace(low, high, points) for name, (low, high) in windows.items()}
        for times in itertools.product(*axes.values()):
            chosen = dict(zip(axes, map(float, times), strict=True))
            runs += 1
            try:
                end = throw(scene, aim, chosen, found.accuracy).end
            except TwolinkError:  # no such throw
                continue
            if end > best:
                best, where = end, chosen
        spacing = {name: float(axis[1] - axis[0]) for name, axis in axes.items()}
        change = sum(curvature[name] * (0.5 * spacing[name]) ** 2 / 2.0 for name in spacing)
        if change <= NEAR / 2.0:
            finest = {name: size * math.sqrt(NEAR / 2.0 / change) for name, size in spacing.items()}  # that will do
            plain = math.prod(round((high - low) / finest[name]) + 1 for name, (low, high) in aim.windows.items())
            return best, where, runs, plain
        windows = {name: (max(low, where[name] - ZOOM * spacing[name]), min(high, where[name] + ZOOM * spacing[name]))
                   for name, (low, high) in aim.windows.items()}  # fmt: skip


def main() -> int:
    given, met = options(__doc__, throws=("pitch", "bowl"), points=7, accuracy=1e-7), []
    for name in given.throws:
        taken, found = once(lambda name=name: search(name, given.accuracy), time.process_time)
        longer, (best, where, runs, plain) = once(lambda found=found: by_grid(found, given.points), time.process_time)
        own, ours = found.best.end, found.found.simulations
        print(f"{name}: {own:.9f} {AIMS[name].unit} ± {found.best.errors['end']:.1e}, {ours} runs, {taken:.2f} s; "
              f"zooming grid {best:.9f}, {runs} runs, {longer:.2f} s; plain grid {plain} runs")  # fmt: skip
        print("  " + ", ".join(f"{what} {found.best.times[what]:.7f} (grid {t:.7f}) s" for what, t in where.items()))
        met.append(print_bars([
            (abs(own - best) <= NEAR, f"distance {abs(own - best):.1e} (bar {NEAR:g})"),
            (ours <= SHARE * plain, f"runs 1 / {plain / ours:.0f} of the plain grid's (bar 1 / {1 / SHARE:g}), "
                                    f"1 / {runs / ours:.1f} of the zooming one's"),
        ]))  # fmt: skip
    return 0 if all(met) else 1


if __name__ == "__main__":
    raise SystemExit(main())
