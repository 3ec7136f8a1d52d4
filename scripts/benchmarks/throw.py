"""The best throw by slopes, beside a grid of release times.

Both answer to the same accuracy. The grid's spacing must change the aim by no more than 1e-6 (by the second derivatives
that the search tells). A plain grid of that spacing is counted, not computed: one that zooms in around its best point
finds the same place with fewer runs, the fewest without slopes. Both counts are shown; the bar is of the plain one.

    python scripts/bench_throw.py [--throws pitch,bowl] [--points 7] [--accuracy 1e-7]

Ends 0 if the search finds what the grid finds to 1e-6, with a tenth of the plain grid's runs.
"""

import argparse
import itertools
import math
import time

import numpy as np

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
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--throws", default="pitch,bowl")
    parser.add_argument("--points", type=int, default=7)
    parser.add_argument("--accuracy", type=float, default=1e-7)
    options = parser.parse_args()
    good = True
    for name in options.throws.split(","):
        begin = time.process_time()
        found = search(name, options.accuracy)
        middle = time.process_time()
        best, where, runs, plain = by_grid(found, options.points)
        end, own, unit = time.process_time(), found.best.end, AIMS[name].unit
        off, share = abs(own - best), found.found.simulations / plain
        met = own >= best - NEAR and off <= NEAR and share <= SHARE
        good &= met
        print(f"{name}: {own:.9f} {unit} ± {found.best.errors['end']:.1e}, {found.found.simulations} runs, "
              f"{middle - begin:.2f} s; zooming grid {best:.9f}, {runs} runs, {end - middle:.2f} s; plain grid "
              f"{plain} runs")  # fmt: skip
        times = ", ".join(f"{what} {found.best.times[what]:.7f} (grid {where[what]:.7f}) s" for what in where)
        print(f"  {times}\n  {'met   ' if met else 'MISSED'}  distance {off:.1e} (bar 1e-6), runs 1 / {1 / share:.0f} "
              f"of the plain grid's (bar 1 / 10), 1 / {runs / found.found.simulations:.1f} of the zooming one's"
        )  # fmt: skip
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
