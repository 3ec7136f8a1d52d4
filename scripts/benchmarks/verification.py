"""What does an error bar cost? Verified over unverified runs of bundled scenes, robots from rest, and worlds.

    python -m scripts.benchmarks.verification [--robots 12] [--rounds 5]

Median seconds after warm-up, by the best code, of `simulate` at the same accuracy with and without verification, and of
the run that is returned without its error bar (alone): its tolerance is smaller where the first one does not do. Of
worlds, each of which has a tolerance of its own, alone is the unverified time by the steps of what is returned.
--robots: of the catalogue, evenly. Prints the table, which goes to out/verification.csv, and the bars for verified over
alone: median at most 2, worst at most 3.
"""

import statistics
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import Table, options, print_bars, seconds_of
from scripts.tasks import alone, loaded
from twolink.errors import TwolinkError

MEDIAN, WORST = 2.0, 3.0
AT_LEAST = 0.2  # s: short runs are repeated for so long
HEADS = ("kind <13 | what <24 | accuracy >8.0e | method <18 | setting >8.2g | unverified, ms >9.2f | alone, ms >9.2f "
         "| verified, ms >9.2f | over unverified >6.2f | over alone >6.2f")  # fmt: skip
Case = tuple[str, str, float, partial[Any]]


def cases(robots: int) -> Iterator[Case]:
    """The kind, the name, the accuracy, and what loads the scene; of worlds the verified run."""

    def rest(name: str) -> tl.Scene:
        return tl.Scene(tl.load_robot(name), effects=[tl.effects.Gravity()], duration=1.0)

    names, random = [row[0] for row in tl.robots().rows], np.random.default_rng(0)
    yield from (("bundled", name, 1e-6, partial(tl.load_scene, name)) for name in loaded(tl.scenes))
    for name in names[:: max(1, len(names) // robots)][:robots]:
        yield "from rest", name, 1e-6, partial(rest, name)
    for name, accuracies in (("arm-swing", (1e-9, 1e-11, 1e-12)), ("ur5", (1e-10, 1e-12))):
        load = partial(tl.load_scene if name == "arm-swing" else rest, name)
        yield from (("near rounding", name, accuracy, load) for accuracy in accuracies)
    for count, accuracy, most in ((64, 1e-6, 0.5), (1024, 1e-6, 0.5), (1024, 1e-10, 0.5), (1024, 1e-6, 2.0)):
        many = partial(tl.simulate_many, tl.load_scene("arm-swing"), q=random.uniform(-most, most, (count, 2)))
        yield "worlds", f"{count} arms from {most:g} rad", accuracy, partial(many, accuracy=accuracy)


def measure(table: Table, case: Case, rounds: int) -> None:
    """A row: unverified, alone where that may differ, and verified."""
    kind, what, accuracy, made = case
    calls: list[Any]
    more = 1.0
    if kind == "worlds":
        calls, said = [made, partial(made, verify=False)], ("dop853", 0.0)
        more = made().steps.sum() / made(verify=False).steps.sum()
    else:
        verified = partial(tl.simulate, scene := made(), accuracy=accuracy)
        cost = (run := verified()).cost
        said = cost.method + f", {cost.precision}" * (cost.precision != "double"), cost.setting
        calls = [verified, partial(verified, verify=False), alone(scene, accuracy, run)]
    full, plain, *other = (1e3 * seconds_of(call, rounds=rounds, warm_up=3, at_least=AT_LEAST)[0] for call in calls)
    bare = other[0] if other else more * plain
    table.add(kind, what, accuracy, *said, plain, bare, full, full / plain, full / bare)


def main() -> int:
    given, table = options(__doc__, robots=12, rounds=5), Table(HEADS)
    for case in cases(given.robots):
        try:
            measure(table, case, given.rounds)
        except TwolinkError as error:  # some stepped contacts do not keep 1e-6
            print(f"{case[1]}: {error}"[:160])
    table.save("verification")
    over_plain, over_alone = zip(*(row[-2:] for row in table.rows), strict=True)
    median, worst = statistics.median(over_alone), max(over_alone)
    print(f"verified over unverified at the same accuracy: median {statistics.median(over_plain):.2f}, worst "
          f"{max(over_plain):.2f}")  # fmt: skip
    return not print_bars([
        (median <= MEDIAN, f"verified over the same run alone, median: {median:.2f} (bar: at most {MEDIAN:g})"),
        (worst <= WORST, f"verified over the same run alone, worst: {worst:.2f} (bar: at most {WORST:g})"),
    ])  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
