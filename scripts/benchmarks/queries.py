"""Batches of dynamics queries, side by side in one run on the same states: Pinocchio, MuJoCo, twolink.

    python -m scripts.benchmarks.queries [--states 100000] [--rounds 9] [--quick]
    python -m scripts.benchmarks.queries --derivatives       # of forward dynamics, a tenth of the states

Every contestant gets all CPUs (TWOLINK_THREADS) and its own preferred layout; conversions that twolink needs for plain
(n, nv) arrays are in its time. The contestants take turns, a warm-up and five calls each, in every round; the table has
medians of all calls. Agreement is the largest difference of the results from Pinocchio's, relative to the largest
entry of the batch. Two more lines show how near the machine's limits are: a compiled function that reads and writes as
many numbers in columns and only adds them, and the time of as many multiplications and additions in independent chains,
which have no division, and no operation that waits for another. --quick: arm, UR5, Panda and one chain only. Writes
out/queries.csv.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.heyoka_peer import heyoka
from scripts.runner import FINGERS, Table, options, seconds_of
from twolink.algorithms.functions import function
from twolink.dynamics import kernels
from twolink.dynamics.threads import thread_count
from twolink.hard.cases.smooth import chain_urdf
from twolink.hard.peers import mujoco_peer
from twolink.hard.peers.task import task_of

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
        who |= mujoco_contest(other, *states, threads)  # type: ignore[call-arg]
    who["twolink, rows"] = lambda: ask(*states, engine="compiled")
    who["twolink, columns"] = lambda: ask(*columns, engine="compiled")
    who[MOVING] = moving(states, robot.nv)
    return who


def moving(states: list[np.ndarray], outputs: int) -> Callable[[], np.ndarray]:
    """Read and write as many numbers in columns, and do nothing but add them."""
    x = [heyoka().expression(f"x{i}") for i in range(sum(s.shape[1] for s in states))]
    add = heyoka().cfunc([sum(x[i + outputs :: outputs], x[i]) for i in range(outputs)], vars=x)
    columns, out = np.ascontiguousarray(np.hstack(states).T), np.empty((outputs, len(states[0])))
    return lambda: add(columns, outputs=out, batch_parallel=True).T


def seconds_of_operation(states: int = 20_000) -> float:
    """Seconds of a multiplication or addition in independent chains, on all threads."""
    x = [heyoka().expression(f"x{i}") for i in range(2)]
    chains = [x[0] + float(i) for i in range(CHAINED)]
    for k in range(PEAK // 2):
        chains[k % CHAINED] = chains[k % CHAINED] * x[1] + x[0]
    busy, out = heyoka().cfunc(chains, vars=x), np.empty((CHAINED, states))
    columns = np.random.default_rng(0).uniform(0.1, 0.9, (2, states))
    (seconds,) = seconds_of(lambda: busy(columns, outputs=out, batch_parallel=True), rounds=20, warm_up=0, pick=min)
    return seconds / (PEAK * states)


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


def compare(chosen: dict[str, tl.Robot], queries: tuple[str, ...], states: int, rounds: int) -> None:
    """The table; `times` says how many times as fast as Pinocchio's parallel batches."""
    operation = seconds_of_operation()
    print(f"{states} states, {thread_count()} threads, medians of {rounds} rounds")
    table = Table("robot <8 | query <28 | nv >3 | operations >10 | who <26 | ns >10.1f | times >8.2f | error >7.0e")
    for name, robot in chosen.items():
        drawn = draw(robot, states if robot.nv < 20 else states // 4)
        for query in queries:
            robot.compiled().certificate(query)
            who = contest(robot, query, drawn)
            answers = {one: np.array(call()) for one, call in who.items()}
            taken = seconds_of(*who.values(), rounds=rounds, turn=TURN, before=1, warm_up=0)
            ns = {one: 1e9 * t / len(answers[one]) for one, t in zip(who, taken, strict=True)}
            operations = sum(kernels.build(robot.model, function(robot.model, query)).operations.values())
            ns["limit: arithmetic"] = operations * operation * 1e9
            best = min(list(ns)[:2], key=ns.__getitem__)
            reference = next((one for one in ns if one.endswith("InParallel")), best)
            truth = answers[reference]
            for one, time in ns.items():
                count, error = min(len(answers.get(one, truth)), len(truth)), None
                if not one.startswith("limit"):
                    error = np.abs(answers[one][:count] - truth[:count]).max() / np.abs(truth).max()
                table.add(name, query, robot.nv, operations, one, time, ns[reference] / time, error)
    table.save("queries")


def main() -> None:
    given = options(__doc__, states=100_000, rounds=9, quick=False, derivatives=False)
    chosen = robots(given.quick)
    if given.derivatives:
        few = {name: robot for name, robot in chosen.items() if robot.nv < 20}
        compare(few, ("forward_dynamics_derivatives",), given.states // 10, given.rounds)
    else:
        compare(chosen, ("forward_dynamics", "inverse_dynamics"), given.states, given.rounds)


if __name__ == "__main__":
    main()
