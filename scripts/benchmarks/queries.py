"""Batches of dynamics queries, side by side in one run on the same states: Pinocchio, MuJoCo, twolink.

    python -m scripts.benchmarks.queries [--states 100000] [--rounds 9] [--quick]
    python -m scripts.benchmarks.queries --derivatives       # of forward dynamics, a tenth of the states

Every contestant gets all CPUs (TWOLINK_THREADS) and its own preferred layout; conversions that twolink needs for plain
(n, nv) arrays are in its time. The contestants take turns, a warm-up and five calls each, in every round; the table has
medians of all calls. Loops take a hundredth of the batch. Agreement is the largest difference of the results from
Pinocchio's, relative to the largest entry of the batch. --quick: arm, UR5, Panda and one chain only. Writes
out/queries.csv.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.mujoco_world import MujocoWorld
from scripts.runner import Table, options, seconds_of
from scripts.tasks import robot_of
from twolink.algorithms.functions import function
from twolink.dynamics import kernels
from twolink.dynamics.threads import thread_count

MODELS = ("arm", "ur5", "panda", "anymal", "talos")
CHAINS = ("chain2", "chain4", "chain8", "chain15", "chain30", "chain60")
TURN = 5
DERIVATIVES = "forward_dynamics_derivatives"
Contest = dict[str, Callable[[], np.ndarray]]


def draw(robot: tl.Robot, n: int) -> list[np.ndarray]:
    """n states (q, v, w) of which 2,000 differ."""
    q, v = robot.random_state(min(n, 2_000))
    return [np.resize(x, (n, x.shape[1])) for x in (q, 2 * v, 20 * v[::-1])]


def mujoco_model(robot: tl.Robot) -> mujoco.MjModel | None:
    """The same robot in MuJoCo, without contacts, limits and damping; None where its joints differ from MuJoCo's."""
    if robot.nq != robot.nv or robot.joint_names[0] == "root_joint":
        return None
    return MujocoWorld(tl.Scene(robot, effects=[tl.effects.Gravity()]), 1e-4).model


def contest(robot: tl.Robot, query: str, states: list[np.ndarray]) -> Contest:
    """Everyone's answer to a query of the batch; of derivatives (da/dq, da/dv, da/dtau) the first."""
    columns = [np.ascontiguousarray(x.T).T for x in states]

    def ours(arrays: list[np.ndarray]) -> np.ndarray:
        answer = getattr(robot, query)(*arrays, engine="compiled")
        return answer[0] if query == DERIVATIVES else answer

    who = pinocchio_contest(robot, query, states)
    other = mujoco_model(robot) if query == "forward_dynamics" else None
    if other is not None:
        who |= mujoco_contest(other, *states)
    return who | {"twolink, rows": lambda: ours(states), "twolink, columns": lambda: ours(columns)}


def pinocchio_contest(robot: tl.Robot, query: str, states: list[np.ndarray]) -> Contest:
    model, threads, few = robot.model, thread_count(), [x[: len(x) // 100] for x in states]
    one, many = {"forward_dynamics": (pin.aba, pin.abaInParallel), "inverse_dynamics": (pin.rnea, pin.rneaInParallel),
                 DERIVATIVES: (pin.computeABADerivatives, None)}[query]  # fmt: skip
    pool, out = pin.ModelPool(model, threads), np.empty((robot.nv, len(states[0])), order="F")

    datas = [model.createData() for _ in range(threads)]

    def loop(data: pin.Data, *part: np.ndarray) -> np.ndarray:
        answers = (one(model, data, *state) for state in zip(*part, strict=True))
        return np.array([answer[0].copy() if many is None else answer for answer in answers])

    def parallel() -> np.ndarray:
        if many is not None:
            many(threads, pool, *(x.T for x in states), out)
            return out.T
        with ThreadPoolExecutor(threads) as workers:
            return np.concatenate([*workers.map(loop, datas, *(np.array_split(x, threads) for x in few))])

    together = f"pin.{many.__name__}" if many else "the same, threads"
    return {f"pin.{one.__name__}, loop": lambda: loop(datas[0], *few), together: parallel}


def mujoco_contest(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, w: np.ndarray) -> Contest:
    spec, threads = mujoco.mjtState.mjSTATE_FULLPHYSICS.value, thread_count()
    control = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
    initial = np.zeros((len(q), mujoco.mj_stateSize(model, spec)))
    initial[:, 1 : 1 + model.nq], initial[:, 1 + model.nq : 1 + 2 * model.nq] = q, v
    pool, workers = mujoco.rollout.Rollout(nthread=threads), [mujoco.MjData(model) for _ in range(threads)]
    many = [model] * len(q)

    def rollout() -> np.ndarray:
        after, _ = pool.rollout(many, workers, initial, w[:, None, :], control_spec=control, nstep=1)
        return (after[:, 0, 1 + model.nq : 1 + 2 * model.nq] - v) / model.opt.timestep

    return {"mujoco rollout, one step": rollout}


def compare(name: str, query: str, states: int, rounds: int, table: Table) -> None:
    """Rows of the table; `times` says how many times as fast as Pinocchio's parallel batches."""
    robot = robot_of(name)
    robot.compiled().certificate(query)
    who = contest(robot, query, draw(robot, states if robot.nv < 20 else states // 4))
    answers = {one: np.array(call()) for one, call in who.items()}
    taken = seconds_of(*who.values(), rounds=rounds, turn=TURN, before=1, warm_up=0)
    ns = {one: 1e9 * t / len(answers[one]) for one, t in zip(who, taken, strict=True)}
    operations = sum(kernels.build(robot.model, function(robot.model, query)).operations.values())
    reference = next((one for one in ns if one.endswith("InParallel")), min([*ns][:2], key=ns.__getitem__))
    truth = answers[reference]
    for one, time in ns.items():
        count = min(len(answers[one]), len(truth))
        error = np.abs(answers[one][:count] - truth[:count]).max() / np.abs(truth).max()
        table.add(name, query, robot.nv, operations, one, time, ns[reference] / time, error)


def main() -> None:
    given = options(__doc__, states=100_000, rounds=9, quick=False, derivatives=False)
    names, states = (*MODELS[:3], "chain30") if given.quick else (*MODELS, *CHAINS), given.states
    queries: tuple[str, ...] = ("forward_dynamics", "inverse_dynamics")
    if given.derivatives:
        names, queries, states = [name for name in names if robot_of(name).nv < 31], (DERIVATIVES,), states // 10
    print(f"{states} states, {thread_count()} threads, medians of {given.rounds} rounds")
    table = Table("robot <8 | query <28 | nv >3 | operations >10 | who <31 | ns >10.1f | times >8.2f | error >7.0e")
    for name in names:
        for query in queries:
            compare(name, query, states, given.rounds, table)
    table.save("queries")


if __name__ == "__main__":
    main()
