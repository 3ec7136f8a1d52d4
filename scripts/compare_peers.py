"""The same scene and initial state in SciPy with pin.aba, MuJoCo, Drake and twolink: error against seconds.

    python scripts/compare_peers.py [--scene arm-swing] [--budget 1] [--rounds 3] [--quick]

Scenes: the arm-swing scene (10 s); UR5 and Panda (fingers locked) falling from rest (2 s); no floor, no joint limits,
no damping, no armature. Peers get their models from the numbers in the pin.Model, and their accelerations are compared
with pin.aba's before anything is timed. Everybody solves one trajectory on one thread, and delivers q at 21 equally
spaced times; twolink also delivers its usual 200 samples a second of q, v and energy within its time.
Error: max |q - q_ref| over those times and all joints, rad. The reference is a Taylor series in long double.
Seconds: the solving call alone, models and compiled code being there; medians, everybody taking turns in every round.
A ladder of settings ends after the first that takes more than the budget. Drake: pip install drake.
Writes out/compare_peers.csv and out/compare_peers.png.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import os
import platform
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

from peers import own_peer, scipy_peer
from peers.problem import COARSE, FINE, Contestant, Problem, Reference, RefusedError, Rung, largest_difference, problems
from peers.report import Entry, picture, print_scene

OUT = Path(__file__).parents[1] / "out"
AGREED = 1e-10  # relative: accelerations that differ by more belong to another robot
TURN = 0.05  # seconds of calls a turn of one contestant's setting, one call at least and ten at most


@dataclass
class Runner:
    """One setting that is to be timed, and its times so far [s]."""

    contestant: str
    rung: Rung
    error: float
    evaluations: int | None
    first: float
    seconds: list[float] = field(default_factory=list)

    def turn(self) -> None:
        """A few calls in a row; a short one is called once more before."""
        calls = max(1, min(10, int(TURN / self.first)))
        if self.first < 4 * TURN:
            self.rung.run()
        for _ in range(calls):
            start = time.perf_counter()
            self.rung.run()
            self.seconds.append(time.perf_counter() - start)

    def entry(self, scene: str) -> Entry:
        return Entry(scene, self.contestant, self.rung.setting, self.error, statistics.median(self.seconds),
                     self.evaluations, len(self.seconds))  # fmt: skip


def climb(contestant: Contestant, reference: Reference, budget: float) -> Iterator[Runner]:
    """Every rung once, up to the first that takes more than the budget; this is the warm-up as well."""
    for rung in contestant.rungs:
        start = time.perf_counter()
        try:
            answer = rung.run()
            first = time.perf_counter() - start
            if first > budget:  # perhaps only because something was compiled
                start = time.perf_counter()
                answer = rung.run()
                first = time.perf_counter() - start
        except RefusedError as error:
            print(f"  {contestant.name}, {rung.setting}: left out: {error}")
            if time.perf_counter() - start > budget:
                return
            continue
        yield Runner(contestant.name, rung, reference.error(answer.q), answer.evaluations, first)
        if first > budget:
            return


def peer_modules() -> dict[str, Any]:
    """MuJoCo and Drake, those that are installed."""
    found = {}
    for name in ("mujoco", "drake"):
        try:
            found[name] = importlib.import_module(f"peers.{name}_peer")
        except ImportError as error:
            print(f"{name} is left out: {error}")
    return found


def require_agreement(problem: Problem, reference: Reference, modules: dict[str, Any]) -> None:
    """Print how far everybody's accelerations are from pin.aba's; end the script where they are another robot's."""
    others = {"reference": reference.accelerations, own_peer.PLAIN: own_peer.accelerations(problem)}
    others |= {name: module.accelerations(problem) for name, module in modules.items()}
    differences = {name: largest_difference(problem, other) for name, other in others.items()}
    shown = ", ".join(f"{name} {d:.0e}" for name, d in differences.items())
    print(f"accelerations against pin.aba, 20 random states, relative: {shown}")
    for name, difference in differences.items():
        if not difference <= AGREED:
            raise SystemExit(f"compare_peers: {name}'s model of {problem.name} is another one: its accelerations "
                             f"differ from pin.aba's by {difference:.1e}, and {AGREED:.0e} is allowed")  # fmt: skip


def measure(problem: Problem, modules: dict[str, Any], options: argparse.Namespace) -> tuple[list[Entry], Reference]:
    """All contestants' entries of one scene, and the reference."""
    reference = Reference(problem)
    start = " ".join(f"{x:g}" for x in problem.scene.q)
    print(f"\n{problem.name}: {problem.duration:g} s from rest at q = ({start}) rad")
    print(
        f"reference good to {reference.doubt:.0e} rad: tolerance {FINE:.0e} against {COARSE:.0e}; "
        f"errors of the initial state grow up to {reference.growth:.0f} times"
    )
    require_agreement(problem, reference, modules)
    whole, half = (2, 4) if options.quick else (1, 1)
    halves = [10 ** (-k / 2) for k in range(2, 33, half)]
    ladders = [own_peer.contestants(problem, [10.0**-k for k in range(1, 13, whole)]),
               scipy_peer.contestants(problem, halves)]  # fmt: skip
    if "mujoco" in modules:
        ladders.append(modules["mujoco"].contestants(problem, 2.0 if options.quick else 2**0.5))
    if "drake" in modules:
        ladders.append(modules["drake"].contestants(problem, halves))
    runners = [r for contestant in chain(*ladders) for r in climb(contestant, reference, options.budget)]
    for _ in range(options.rounds):
        for runner in runners:
            runner.turn()
    return [runner.entry(problem.name) for runner in runners], reference


def main() -> None:
    scenes = problems()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=list(scenes), action="append", help="one scene; may be given again")
    parser.add_argument("--budget", type=float, help="seconds after which a ladder ends (1; quick: 0.3)")
    parser.add_argument("--rounds", type=int, help="turns of everybody (3; quick: 1)")
    parser.add_argument("--quick", action="store_true", help="every other setting, less time, one round")
    options = parser.parse_args()
    options.budget = options.budget or (0.3 if options.quick else 1.0)
    options.rounds = options.rounds or (1 if options.quick else 3)
    if find_spec("heyoka") is None:
        raise SystemExit("compare_peers: the reference needs heyoka, whose wheels are for Linux")
    os.environ["TWOLINK_THREADS"] = "1"
    modules = peer_modules()
    packages = {name: version(name) for name in ("numpy", "scipy", "pin", "heyoka")}
    packages |= {name: module.VERSION for name, module in modules.items()}
    print(f"Python {platform.python_version()}, " + ", ".join(f"{name} {v}" for name, v in packages.items()))
    entries: list[Entry] = []
    for name in options.scene or scenes:
        mine, reference = measure(scenes[name], modules, options)
        print_scene(mine, reference.doubt)
        entries += mine
    OUT.mkdir(exist_ok=True)
    with (OUT / "compare_peers.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "contestant", "setting", "error_rad", "seconds", "evaluations", "calls"])
        writer.writerows(e.row() for e in entries)
    picture(entries, OUT / "compare_peers.png")
    print(f"\nwrote {OUT / 'compare_peers.csv'} and {OUT / 'compare_peers.png'}")


if __name__ == "__main__":
    main()
