"""What does an error bar cost? Verified over unverified runs of bundled scenes, robots from rest, and worlds.

    python -m scripts.benchmarks.verification [--robots 12] [--rounds 5]

Median seconds after warm-up, by the best code, of `simulate` at the same accuracy with and without verification, and of
the run that is returned without its error bar (alone): its tolerance is smaller where the first one does not do.
--robots: of the catalogue, evenly. Prints the table, which goes to out/verification.csv, and the bars for verified over
alone: median at most 2, worst at most 3.
"""

import statistics
from functools import partial

import numpy as np

import twolink as tl
from scripts.runner import Table, options, print_bars, seconds_of
from twolink.errors import TwolinkError

MEDIAN, WORST = 2.0, 3.0
AT_LEAST = 0.2  # s: short runs are repeated for so long
WARM_UP = 3
HEADS = ("kind <13 | what <24 | accuracy >8.0e | method <18 | setting >8.2g | unverified, ms >9.2f | alone, ms >9.2f "
         "| verified, ms >9.2f | over unverified >6.2f | over alone >6.2f")  # fmt: skip


class Measurements:
    """The table of all cases."""

    def __init__(self, rounds: int) -> None:
        self.rounds, self.table = rounds, Table(HEADS)

    def add(self, kind: str, what: str, accuracy: float, method: str, setting: float, *calls: partial[object]) -> None:
        """A row: unverified, verified, and alone where that differs from unverified."""
        times = [1e3 * seconds_of(call, rounds=self.rounds, warm_up=WARM_UP, at_least=AT_LEAST)[0] for call in calls]
        plain, full, alone = times[0], times[1], times[-1] if len(times) == 3 else times[0]
        self.table.add(kind, what, accuracy, method, setting, plain, alone, full, full / plain, full / alone)

    def scene(self, kind: str, what: str, scene: tl.Scene, accuracy: float) -> None:
        verified = partial(tl.simulate, scene, accuracy=accuracy)
        cost = verified().cost
        assert cost is not None
        digits = {"precision": cost.precision} if cost.precision != "double" else {}
        setting = {"tolerance": cost.tolerance} if cost.tolerance else {"step": cost.step}
        alone = partial(tl.simulate, scene, accuracy=accuracy, method=cost.method, verify=False, **setting, **digits)
        if cost.method == "stepped":
            alone = partial(tl.simulate, scene, step=cost.step, verify=False)
        self.add(kind, what, accuracy, ", ".join([cost.method, *digits.values()]), cost.setting,
                 partial(tl.simulate, scene, accuracy=accuracy, verify=False), verified, alone)  # fmt: skip


def measure(found: Measurements, robots: int) -> None:
    """All cases that can be made."""
    gravity = [tl.effects.Gravity()]
    for name, *_ in tl.scenes().rows:
        try:
            found.scene("bundled", name, tl.load_scene(name), 1e-6)
        except TwolinkError as error:  # some stepped contacts do not keep 1e-6
            print(f"{name}: {error}"[:160])
    catalogue = [row[0] for row in tl.robots().rows]
    chosen = catalogue if robots >= len(catalogue) else catalogue[:: max(1, len(catalogue) // robots)][:robots]
    for name in chosen:
        try:
            found.scene("from rest", name, tl.Scene(tl.load_robot(name), effects=gravity, duration=1.0), 1e-6)
        except TwolinkError as error:
            print(f"{name}: {error}"[:160])
    arm = tl.load_scene("arm-swing")
    for accuracy in (1e-9, 1e-11, 1e-12):
        found.scene("near rounding", "arm-swing", arm, accuracy)
    for accuracy in (1e-10, 1e-12):
        ur5 = tl.Scene(tl.load_robot("ur5"), effects=gravity, duration=1.0)
        found.scene("near rounding", "ur5", ur5, accuracy)
    random = np.random.default_rng(0)
    for count, accuracy, most in ((64, 1e-6, 0.5), (1024, 1e-6, 0.5), (1024, 1e-10, 0.5), (1024, 1e-6, 2.0)):
        many = partial(tl.simulate_many, arm, q=random.uniform(-most, most, (count, 2)), accuracy=accuracy)
        found.add(
            "worlds", f"{count} arms from {most:g} rad", accuracy, "dop853", 0.0, partial(many, verify=False), many
        )


def main() -> int:
    given = options(__doc__, robots=12, rounds=5)
    found = Measurements(given.rounds)
    measure(found, given.robots)
    found.table.save("verification")
    over_plain, over_alone = zip(*(row[-2:] for row in found.table.rows), strict=True)
    median, worst = statistics.median(over_alone), max(over_alone)
    print(f"verified over unverified at the same accuracy: median {statistics.median(over_plain):.2f}, worst "
          f"{max(over_plain):.2f}")  # fmt: skip
    met = print_bars([
        (median <= MEDIAN, f"verified over the same run alone, median: {median:.2f} (bar: at most {MEDIAN:g})"),
        (worst <= WORST, f"verified over the same run alone, worst: {worst:.2f} (bar: at most {WORST:g})"),
    ])  # fmt: skip
    return 0 if met else 1


if __name__ == "__main__":
    raise SystemExit(main())
