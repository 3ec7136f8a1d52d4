"""The same scene and initial state in SciPy with pin.aba, MuJoCo, Drake and twolink: error against seconds.

    python -m scripts.benchmarks.peers [--scene arm-swing,panda] [--budget 1] [--rounds 3] [--quick]

Scenes: the arm-swing scene (10 s); UR5 and Panda (fingers locked) falling from rest (2 s); Talos, free in the air and
turning its joints (1 s); no floor, no joint limits, no damping, no armature. Peers get their models from the numbers in
the pin.Model, and their accelerations are compared with pin.aba's before anything is timed. All contestants solve one
trajectory on one thread and deliver q and v at 21 equally spaced times. Another entry of twolink delivers its usual
200 samples a second.
Error: max |q - q_ref| over those times and all joints, rad. The reference is a Taylor series in 31 digits.
Seconds: of the processor, of the solving call alone, after models are built and code is compiled; medians over rounds
in which all contestants take turns.
A method's settings end after the first that takes more than the budget. Needs: pip install twolink[peers].
--quick: every other setting, a budget of 0.3 s instead of 1 s, one round instead of 3.
Writes out/peers.csv.
"""

import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import partial
from itertools import groupby
from types import ModuleType
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import Some, Table, once, options
from scripts.tasks import robot_of
from twolink.errors import TwolinkError
from twolink.hard.case import StateHistory
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import PeerError, PeerRun, PeerTask, task_of
from twolink.hard.truths import COARSE, FINE, extended_reference
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.io.fingerprints import versions

PLAIN, VERIFIED, SAMPLED = "twolink", "twolink, verified", "twolink, 200 samples/s"
LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)  # rad
BARS = {
    "arm-swing": {1e-3: 20.0, 1e-6: 40.0, 1e-9: 50.0, 1e-12: 60.0},
    "ur5": {1e-6: 10.0, 1e-9: 15.0, 1e-12: 20.0},
    "panda": {1e-6: 10.0, 1e-9: 15.0, 1e-12: 20.0},
    "talos": {1e-6: 5.0},
}
"""How many times faster than the cheapest peer twolink is to be, unverified."""
VERIFY_BAR = 3.0  # times the seconds, with the error bar
HEADS = "scene <10 | contestant <24 | setting <18 | error_rad >10.1e | seconds >10.6f | evaluations >12 | calls >6"


@dataclass(frozen=True)
class Entry:
    """A contestant at one setting: its error [rad], median seconds of `calls` calls, evaluations of the dynamics."""

    scene: str
    contestant: str
    setting: str
    error_rad: float
    seconds: float
    evaluations: int | None
    calls: int


def print_scene(entries: list[Entry], doubt: float) -> Table:
    """All entries of one scene, then who is cheapest for each error, and the cost of verifying. Returns the first."""
    every = Table(HEADS)
    for e in entries:
        every.add(*astuple(e))
    print()
    table = Table("error <7.0e | cheapest peer <38 | ms >9.3f | twolink <15 | ours, ms >9.3f | ratio >6.1f | bar <4")
    for level in LEVELS:
        peer = _cheapest((e for e in entries if not e.contestant.startswith(PLAIN)), level)
        ours = _cheapest((e for e in entries if e.contestant == PLAIN), level)
        bar = _verdict(peer, ours, BARS.get(entries[0].scene, {}).get(level))
        table.add(level, f"{peer.contestant}, {peer.setting}" if peer else "none gets there",
                  peer and 1e3 * peer.seconds, ours.setting if ours else "none", ours and 1e3 * ours.seconds,
                  peer.seconds / ours.seconds if peer and ours else None,
                  bar if doubt <= level / 10 else "the reference is too coarse")  # fmt: skip
    _print_verifying(entries)
    return every


def _cheapest(entries: Iterable[Entry], level: float) -> Entry | None:
    return min((e for e in entries if e.error_rad <= level), key=lambda e: e.seconds, default=None)


def _verdict(peer: Entry | None, ours: Entry | None, bar: float | None) -> str:
    if bar is None:
        return "none set"
    if ours is None:
        return f"{bar:g}x missed"
    if peer is None:
        return f"{bar:g}x met: no peer gets there"
    return f"{bar:g}x {'met' if peer.seconds >= bar * ours.seconds else 'missed'}"


def _print_verifying(entries: list[Entry]) -> None:
    plain = {e.setting: e.seconds for e in entries if e.contestant == PLAIN}
    ratios = {e.setting: e.seconds / plain[e.setting] for e in entries
              if e.contestant == VERIFIED and e.setting in plain}  # fmt: skip
    shown = ", ".join(f"{setting.split()[-1]} {r:.2f}" for setting, r in ratios.items()) or "nothing to compare"
    met = "met" if max(ratios.values(), default=0.0) <= VERIFY_BAR else "missed"
    print(f"  verified, times the seconds: {shown}; bar {VERIFY_BAR:g}x {met}")


INTERVALS, SAMPLES = 20, 200.0  # between the common times; a second, twolink's default
AGREED = 1e-10  # relative: accelerations that differ by more belong to a different model
TURN = 0.05  # seconds of calls in a turn of one setting; one to ten calls
PERTURBATION = 1e-9  # rad, rad/s: of the initial state, to see how much it grows
Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Timing:
    """One setting of a contestant, with the seconds of its first call, and the seconds of its timed calls."""

    def __init__(self, entry: Entry, run: Callable[[], PeerRun]) -> None:
        self.entry, self.run, self.seconds = entry, run, list[float]()

    def turn(self) -> None:
        """A few calls in a row; a short one is called once more before."""
        calls, short = max(1, min(10, int(TURN / self.entry.seconds))), self.entry.seconds < 4 * TURN
        self.seconds += [once(self.run, time.process_time)[0] for _ in range(calls + short)][short:]


def compared_scenes() -> dict[str, tuple[tl.Scene, float]]:
    """Scenes under gravity, with their durations [s]."""
    gravity = [tl.effects.Gravity()]
    ur5 = tl.Scene(robot_of("ur5"), (0.3, -0.8, 1.2, -0.7, 0.5, 0.2), effects=gravity)
    panda = tl.Scene(robot_of("panda"), (-0.7, 1.4, -0.4, -0.2, -0.8, 1.1, -0.7), effects=gravity)
    talos = robot_of("talos")
    spread = np.cos(np.arange(talos.nv))  # rad, and rad/s or m/s: no two joints alike
    turning = tl.Scene(talos, talos.integrate(talos.neutral, 0.5 * spread), spread, effects=gravity)
    return {"arm-swing": (tl.load_scene("arm-swing"), 10.0), "ur5": (ur5, 2.0), "panda": (panda, 2.0),
            "talos": (turning, 1.0)}  # fmt: skip


def installed_peers() -> dict[str, ModuleType]:
    modules = {}
    for name in NAMES:
        try:
            modules[name] = peer_module(name)
        except ImportError as error:
            print(f"{name} is left out: {error}")
    return modules


def measure(name: str, scene: tl.Scene, duration: float, modules: dict[str, ModuleType], given: Any) -> Table:
    """Print the tables of one scene. Returns that of all contestants' entries."""
    task = task_of(scene, np.linspace(0.0, duration, INTERVALS + 1))
    reference, doubt = extended_reference(scene, task.times)
    growth = largest_growth(scene, task.times, reference)
    print(f"\n{name}: {duration:g} s from q = ({' '.join(f'{x:.3g}' for x in scene.q)})")
    print(f"reference good to {doubt[-1]:.0e} rad: tolerance {FINE:.0e} against {COARSE:.0e}; "
          f"errors of the initial state grow up to {growth:.0f} times")  # fmt: skip
    require_agreement(name, task, modules)
    timings = [*own_timings(name, scene, task.times, reference, given)]
    for peer, module in modules.items():
        for method, settings in groupby(module.all_settings(task, given.quick), key=lambda s: s.method):
            runs = ((s.words, module.prepare(task, s)) for s in settings)
            timings += climb(name, f"{NAMES[peer]} {method}", runs, reference, given.budget)
    for _ in range(given.rounds):
        for timing in timings:
            timing.turn()
    entries = [replace(t.entry, seconds=statistics.median(t.seconds), calls=len(t.seconds)) for t in timings]
    return print_scene(entries, doubt[-1])


def largest_growth(scene: tl.Scene, times: np.ndarray, reference: np.ndarray) -> float:
    """How many times an error of the initial state grows, the largest of four random directions."""
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(4):
        dq, dv = PERTURBATION * random.uniform(-1, 1, (2, scene.robot.nv))
        q = scene.robot.integrate(scene.q, dq)
        other, _ = extended_reference(tl.Scene(scene.base, q, scene.v + dv, scene.effects), times)
        worst = max(worst, error_of(other, reference) / PERTURBATION)
    return worst


def error_of(q: np.ndarray, reference: np.ndarray) -> float:
    """max |q - reference| over the times and joints, rad."""
    return float(np.abs(q - reference).max())


def require_agreement(name: str, task: PeerTask, modules: dict[str, ModuleType]) -> None:
    """Print how far all accelerations are from pin.aba's; end the script where the models differ."""
    zero = np.zeros(task.model.nv)
    others: dict[str, Acceleration] = {peer: module.accelerations(task) for peer, module in modules.items()}
    aba = others.pop("scipy")
    others[PLAIN] = lambda q, v: np.asarray(task.robot.forward_dynamics(q, v, zero, engine="compiled"))
    differences = {who: largest_difference(task, other, aba) for who, other in others.items()}
    shown = ", ".join(f"{who} {d:.0e}" for who, d in differences.items())
    print(f"accelerations against pin.aba, 20 random states, relative: {shown}")
    for who, difference in differences.items():
        if not difference <= AGREED:
            raise SystemExit(f"peers: {who}'s model of {name} differs: its accelerations are off "
                             f"pin.aba's by {difference:.1e}, and {AGREED:.0e} is allowed")  # fmt: skip


def largest_difference(task: PeerTask, other: Acceleration, aba: Acceleration, states: int = 20) -> float:
    """max |a - a_aba| / max |a_aba| over the joints, the worst of some random states up to 2 rad and 2 rad/s.

    Without a free body's own acceleration, which each peer has in other axes: the joints' depend on it.
    """
    random, worst = np.random.default_rng(0), 0.0
    joints = np.concatenate([np.arange(j.v.start, j.v.stop) for j in task.joints if j.kind != "free"])
    for _ in range(states):
        dq, v = random.uniform(-2, 2, (2, task.model.nv))
        q = task.robot.integrate(task.robot.neutral, dq)
        a = np.array(aba(q, v))[joints]
        worst = max(worst, float(np.abs(other(q, v)[joints] - a).max() / np.abs(a).max()))
    return worst


def own_timings(name: str, scene: tl.Scene, times: np.ndarray, reference: np.ndarray, given: Any) -> Iterator[Timing]:
    """twolink by its public call alone, without and with the second solution behind the error bar."""

    def solve(accuracy: float, verify: bool, samples: float) -> PeerRun:
        wanted = np.round(times * samples).astype(int)
        try:
            got = tl.simulate(scene, float(times[-1]), accuracy=accuracy, samples_per_second=samples, verify=verify)
        except TwolinkError as error:
            raise PeerError(str(error)) from None
        if np.abs(got.t[wanted] - times).max() > 1e-12:
            raise PeerError("the samples are not at the common times")
        return PeerRun(StateHistory(times, got.q[wanted], got.v[wanted]), got.cost.evaluations)

    for method in ("rk45", "dop853"):  # else the first runs would take steps that are compiled in parts
        step_map(equations_of(scene), METHODS[method])
    accuracies = [10.0**-k for k in range(1, 13, 2 if given.quick else 1)]
    few = INTERVALS / float(times[-1])
    for contestant, verify, samples in ((PLAIN, False, few), (VERIFIED, True, few), (SAMPLED, False, SAMPLES)):
        runs = ((f"accuracy {a:.0e}", partial(solve, a, verify, samples)) for a in accuracies)
        yield from climb(name, contestant, runs, reference, given.budget)


def climb(
    scene: str, contestant: str, runs: Iterator[tuple[str, Callable[[], PeerRun]]], reference: np.ndarray, budget: float
) -> Iterator[Timing]:
    """Every setting once, up to the first that takes more than the budget; this is the warm-up as well."""
    first = 0.0
    for setting, run in runs:
        start = time.process_time()
        try:
            first, answer = once(run, time.process_time)
            if first > budget:  # perhaps only because it compiled
                first, answer = once(run, time.process_time)
        except PeerError as error:
            print(f"  {contestant}, {setting}: left out: {str(error).splitlines()[0]}")
            first = time.process_time() - start
        else:
            off = error_of(answer.track.q, reference)
            yield Timing(Entry(scene, contestant, setting, off, first, answer.evaluations, 1), run)
        if first > budget:
            return


def main() -> None:
    scenes = compared_scenes()
    given = options(__doc__, scene=Some(scenes), budget=float, rounds=int, quick=False)
    given.budget = given.budget or (0.3 if given.quick else 1.0)
    given.rounds = given.rounds or (1 if given.quick else 3)
    os.environ["TWOLINK_THREADS"] = "1"
    modules = installed_peers()
    packages = versions(("numpy", "pin")) | {name: module.VERSION for name, module in modules.items()}
    print(f"Python {platform.python_version()}, " + ", ".join(f"{name} {v}" for name, v in packages.items()))
    table, *others = [measure(name, *scenes[name], modules, given) for name in given.scene]
    table.rows += [row for other in others for row in other.rows]
    table.save("peers")


if __name__ == "__main__":
    main()
