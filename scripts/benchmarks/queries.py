"""Batches of dynamics queries, side by side in one run on the same states: Pinocchio, MuJoCo, twolink.

    python scripts/bench_queries.py [--states 100000] [--rounds 9] [--quick]
    python scripts/bench_queries.py --derivatives       # of forward dynamics, a tenth of the states
    python scripts/bench_queries.py --cached     # ms in which a new process gets Talos's kernels from the cache
    python scripts/bench_queries.py --engines    # what the rule of twolink/dynamics/engine.py is rounded from
    python scripts/bench_queries.py --sine       # the sine of twolink/algorithms/sincos.py against heyoka's

Every contestant gets all CPUs (TWOLINK_THREADS) and its own preferred layout; conversions that twolink needs for plain
(n, nv) arrays are in its time. The contestants take turns, a warm-up and five calls each, in every round; the table has
medians of all calls. Agreement is the largest difference of the results from Pinocchio's, relative to the largest
entry of the batch. Two more lines show how near the machine's limits are: a compiled function that reads and writes as
many numbers in columns and only adds them, and the time of as many multiplications and additions in independent chains,
which have no division, and no operation that waits for another. Writes out/bench_queries.csv.
"""

import argparse
import csv
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Expressions
from twolink.dynamics import kernels
from twolink.dynamics.engine import compiled_from
from twolink.dynamics.threads import thread_count
from twolink.hard.cases.chains import chain_urdf
from twolink.hard.peers import mujoco_peer
from twolink.hard.peers.task import task_of

OUT = Path(__file__).parents[1] / "out"
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
CHAINS = (2, 4, 8, 15, 30, 60)
TURN = 5
MOVING = "limit: memory"
CHAINED, PEAK = 16, 1024  # chains, and operations in all, of the function that shows the peak of arithmetic
Contest = dict[str, Callable[[], np.ndarray]]


def chain(n: int) -> tl.Robot:
    """A chain of n rods of 1 m and 1 kg, bending in a plane."""
    return tl.load_robot(chain_urdf([1.0] * n))


def robots(quick: bool) -> dict[str, tl.Robot]:
    chosen = {"arm": tl.load_robot("arm"), "ur5": tl.load_robot("ur5"), "panda": tl.load_robot("panda", lock=FINGERS)}
    if quick:
        return chosen | {"chain30": chain(30)}
    chosen |= {"anymal": tl.load_robot("anymal", root="free"), "talos": tl.load_robot("talos", root="free")}
    return chosen | {f"chain{n}": chain(n) for n in CHAINS}


def draw(robot: tl.Robot, n: int) -> list[np.ndarray]:
    """n states (q, v, w) of which 2,000 differ."""
    q, v = robot.random_state(min(n, 2_000))
    return [np.resize(x, (n, x.shape[1])) for x in (q, 2 * v, 20 * v[::-1])]


def mujoco_model(robot: tl.Robot) -> mujoco.MjModel | None:
    """The same robot in MuJoCo, without contacts, limits and damping; None where its joints differ from MuJoCo's."""
    if robot.nq != robot.nv or robot.joint_names[0] == "root_joint":
        return None
    model = mujoco_peer.build(task_of(tl.Scene(robot, effects=[tl.effects.Gravity()]), np.zeros(2)))
    model.opt.timestep = 1e-4
    return model


def contest(robot: tl.Robot, query: str, states: list[np.ndarray]) -> Contest:
    """Everyone's answer to forward or inverse dynamics of the batch; the loops take a hundredth of it."""
    if query == "forward_dynamics_derivatives":
        return derivatives(robot, states)
    model, data, threads = robot.model, robot.model.createData(), thread_count()
    pool, out = pin.ModelPool(model, threads), np.empty((robot.nv, len(states[0])), order="F")
    one, many = (pin.aba, pin.abaInParallel) if query == "forward_dynamics" else (pin.rnea, pin.rneaInParallel)
    ask = getattr(robot, query)
    few = [x[: len(x) // 100] for x in states]
    columns = [np.ascontiguousarray(x.T).T for x in states]

    def parallel() -> np.ndarray:
        many(threads, pool, *(x.T for x in states), out)
        return out.T

    who: Contest = {
        f"pin.{one.__name__}, loop": lambda: np.array([one(model, data, *s) for s in zip(*few, strict=True)]),
        f"pin.{one.__name__}InParallel": parallel,
    }
    other = mujoco_model(robot) if query == "forward_dynamics" else None
    if other is not None:
        who |= mujoco_contest(other, *states, threads)
    who["twolink, rows"] = lambda: ask(*states, engine="compiled")
    who["twolink, columns"] = lambda: ask(*columns, engine="compiled")
    who[MOVING] = moving(states, robot.nv)
    return who


def moving(states: list[np.ndarray], outputs: int) -> Callable[[], np.ndarray]:
    """Read and write as many numbers in columns, and do nothing but add them."""
    x = [kernels.heyoka().expression(f"x{i}") for i in range(sum(s.shape[1] for s in states))]
    add = kernels.heyoka().cfunc([sum(x[i + outputs :: outputs], x[i]) for i in range(outputs)], vars=x)
    columns, out = np.ascontiguousarray(np.hstack(states).T), np.empty((outputs, len(states[0])))
    return lambda: add(columns, outputs=out, batch_parallel=True).T


def seconds_of_operation(states: int = 20_000) -> float:
    """Seconds of a multiplication or addition in independent chains, on all threads."""
    x = [kernels.heyoka().expression(f"x{i}") for i in range(2)]
    chains = [x[0] + float(i) for i in range(CHAINED)]
    for k in range(PEAK // 2):
        chains[k % CHAINED] = chains[k % CHAINED] * x[1] + x[0]
    busy, out = kernels.heyoka().cfunc(chains, vars=x), np.empty((CHAINED, states))
    columns = np.random.default_rng(0).uniform(0.1, 0.9, (2, states))
    return fastest(lambda: busy(columns, outputs=out, batch_parallel=True), 20) / (PEAK * states)


def derivatives(robot: tl.Robot, states: list[np.ndarray]) -> Contest:
    """Everyone's (da/dq, da/dv, da/dtau) of the batch; the loops take a hundredth of it."""
    model, few = robot.model, [x[: len(x) // 100] for x in states]
    columns = [np.ascontiguousarray(x.T).T for x in states]

    def loop(part: tuple[np.ndarray, ...]) -> list[np.ndarray]:
        data = model.createData()
        return [pin.computeABADerivatives(model, data, *state)[0].copy() for state in zip(*part, strict=True)]

    def threads() -> np.ndarray:
        parts = zip(*(np.array_split(x, thread_count()) for x in few), strict=True)
        with ThreadPoolExecutor(thread_count()) as pool:
            return np.concatenate(list(pool.map(loop, parts)))

    def ours(arrays: list[np.ndarray]) -> np.ndarray:
        return robot.forward_dynamics_derivatives(*arrays, engine="compiled")[0]

    return {
        "pin.computeABADerivatives": lambda: np.array(loop(tuple(few))),
        "the same, threads": threads,
        "twolink, rows": lambda: ours(states),
        "twolink, columns": lambda: ours(columns),
    }


def mujoco_contest(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, w: np.ndarray, threads: int) -> Contest:
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
    control = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
    initial = np.zeros((len(q), mujoco.mj_stateSize(model, spec)))
    initial[:, 1 : 1 + model.nq], initial[:, 1 + model.nq : 1 + 2 * model.nq] = q, v
    pool = mujoco.rollout.Rollout(nthread=threads)
    workers = [mujoco.MjData(model) for _ in range(threads)]
    many = [model] * len(q)

    def rollout() -> np.ndarray:
        after, _ = pool.rollout(many, workers, initial, w[:, None, :], control_spec=control, nstep=1)
        return (after[:, 0, 1 + model.nq : 1 + 2 * model.nq] - v) / model.opt.timestep

    return {"mujoco rollout, one step": rollout}


def run(who: Contest, rounds: int) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Median nanoseconds a state, and the answers; in every round everybody has TURN calls in a row."""
    answers = {name: call() for name, call in who.items()}
    answers = {name: np.array(a) for name, a in answers.items()}
    times: dict[str, list[float]] = {name: [] for name in who}
    for _ in range(rounds):
        for name, call in who.items():
            call()
            for _ in range(TURN):
                start = time.perf_counter()
                call()
                times[name].append((time.perf_counter() - start) / len(answers[name]) * 1e9)
    return {name: statistics.median(t) for name, t in times.items()}, answers


def fastest(call: Callable[[], object], repeats: int) -> float:
    """Seconds of the fastest call."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def engines(chosen: dict[str, tl.Robot], n: int = 2_000) -> None:
    """Seconds of compiling, and of a state by Pinocchio and by the kernel, next to the rule."""
    os.environ["TWOLINK_CACHE"] = "off"
    takes = {"mass_matrix": 1, "gravity_torque": 1, "bias": 2, "energy": 2, "forward_dynamics": 3,
             "inverse_dynamics": 3, "forward_dynamics_derivatives": 3, "inverse_dynamics_derivatives": 3}  # fmt: skip
    print(f"{'robot':<10}{'nv':>4} {'query':<30}{'compiling s':>12}{'Pinocchio us':>14}{'kernel us':>11}{'rule':>9}")
    for name, robot in chosen.items():
        states = draw(robot, n)
        for query, count in takes.items():
            if robot.nv > 20 and "derivatives" in query:
                continue
            start = time.perf_counter()
            robot.compiled().certificate(query)
            compiling = time.perf_counter() - start
            calls = [partial(getattr(robot, query), *states[:count], engine=e) for e in ("pinocchio", "compiled")]
            theirs, ours = (fastest(call, 5) / n * 1e6 for call in calls)
            print(f"{name:<10}{robot.nv:>4} {query:<30}{compiling:>12.2f}{theirs:>14.2f}{ours:>11.3f}"
                  f"{compiled_from(query, robot.nv):>9}", flush=True)  # fmt: skip


def sines(chosen: dict[str, tl.Robot], n: int = 20_000) -> None:
    """Forward dynamics of columns of states with either sine, in turns on one thread."""
    heyoka = kernels.heyoka()
    for name in ("arm", "panda"):
        model = chosen[name].model
        made_of = function(model, "forward_dynamics")
        counts = [sum(count.values()) for count in kernels.count_operations(model, made_of)]
        formula = made_of.variants[counts.index(min(counts))]
        columns = np.ascontiguousarray(np.hstack(draw(chosen[name], n)).T)
        made = []
        for own in (True, False):
            x = [heyoka.expression(f"x{i}") for i in range(len(columns))]
            q, v, tau = x[: model.nq], x[model.nq : -model.nv], x[-model.nv :]
            entries = formula(mechanism(model), {"q": q, "v": v, "tau": tau}, Expressions(heyoka, own_sine=own))
            made.append(heyoka.cfunc(entries, vars=x))
        out = np.empty((model.nv, n))
        times = [[fastest(partial(f, columns, outputs=out), TURN) for f in made] for _ in range(40)]
        own, theirs = (min(t) / n * 1e9 for t in zip(*times, strict=True))
        print(f"{name}: own {own:.1f} ns a state, heyoka's {theirs:.1f} ns, {100 * (theirs / own - 1):.0f} % slower")


def cached(name: str = "talos", root: str = "free") -> None:
    """Milliseconds until each kernel of a robot answers in a new process: first made, then read from the cache."""
    code = f"""
import time, twolink as tl
robot = tl.load_robot({name!r}, root={root!r})
robot.compiled().certificate("gravity_torque")
for query in ("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias"):
    start = time.perf_counter()
    robot.compiled().certificate(query)
    print(query, 1e3 * (time.perf_counter() - start))
"""
    with tempfile.TemporaryDirectory() as cache:
        environment, took = {**os.environ, "TWOLINK_CACHE": cache}, []
        for _ in range(6):
            done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
            took.append({line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()})
    print(f"{name}: ms to make a kernel, and median to read it from the cache")
    for query, made in took[0].items():
        print(f"  {query:<20}{made:>9.0f}{statistics.median(times[query] for times in took[1:]):>9.1f}")


def compare(chosen: dict[str, tl.Robot], queries: tuple[str, ...], states: int, rounds: int) -> None:
    rows, operation = [], seconds_of_operation()
    print(f"{states} states, {thread_count()} threads, medians of {rounds} rounds")
    for name, robot in chosen.items():
        drawn = draw(robot, states if robot.nv < 20 else states // 4)
        for query in queries:
            robot.compiled().certificate(query)
            times, answers = run(contest(robot, query, drawn), rounds)
            counts = kernels.count_operations(robot.model, function(robot.model, query))
            operations = min(sum(c.values()) for c in counts)
            reference = next(
                (name for name in times if name.endswith("InParallel")), min(list(times)[:2], key=times.__getitem__)
            )
            base, truth = times[reference], answers[reference]
            print(f"\n{name}, {query.replace('_', ' ')}: nv = {robot.nv}, {operations} operations")
            moved = times.pop(MOVING, None)
            for who, ns in times.items():
                count = min(len(answers[who]), len(truth))
                error = np.abs(answers[who][:count] - truth[:count]).max() / np.abs(truth).max()
                print(f"  {who:<26}{ns:>10.1f} ns  {base / ns:>8.1f}x  agrees to {error:.0e}")
                rows.append([name, query, robot.nv, operations, who, ns, base / ns, error])
            for limit, ns in ((MOVING, moved), ("limit: arithmetic", operations * operation * 1e9)):
                if ns is not None:
                    print(f"  {limit:<26}{ns:>10.1f} ns  {base / ns:>8.1f}x")
    OUT.mkdir(exist_ok=True)
    with (OUT / "bench_queries.csv").open("w", newline="") as file:
        header = ["robot", "query", "nv", "operations", "who", "ns", "times", "error"]
        csv.writer(file).writerows([header, *rows])
    print(f"\nwrote {OUT / 'bench_queries.csv'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--quick", action="store_true", help="arm, UR5, Panda and one chain only")
    parser.add_argument("--derivatives", action="store_true", help="derivatives of forward dynamics")
    parser.add_argument("--cached", action="store_true", help="reading kernels from the cache")
    parser.add_argument("--engines", action="store_true", help="compiling against Pinocchio, query by query")
    parser.add_argument("--sine", action="store_true", help="our sine against heyoka's")
    options = parser.parse_args()
    if options.cached:
        cached()
        return
    chosen = robots(options.quick)
    if options.derivatives:
        few = {name: robot for name, robot in chosen.items() if robot.nv < 20}
        compare(few, ("forward_dynamics_derivatives",), options.states // 10, options.rounds)
    elif options.engines:
        engines(chosen)
    elif options.sine:
        sines(chosen)
    else:
        compare(chosen, ("forward_dynamics", "inverse_dynamics"), options.states, options.rounds)


if __name__ == "__main__":
    main()
