"""Batches of dynamics queries, side by side in one run on the same states: Pinocchio, MuJoCo, twolink.

    python scripts/bench_queries.py [--states 100000] [--rounds 9] [--quick]

Every contestant gets all CPUs (TWOLINK_THREADS) and its own preferred layout; conversions that twolink needs for plain
(n, nv) arrays are in its time. The contestants
take turns, a warm-up and five calls each, in every round; the table has medians of all calls.
Agreement is the largest difference of accelerations from pin.aba, relative to the largest acceleration of the batch.
Writes out/bench_queries.csv and out/bench_queries.png.
"""

import argparse
import csv
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.algorithms import functions
from twolink.dynamics import kernels
from twolink.dynamics.threads import thread_count

OUT = Path(__file__).parents[1] / "out"
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
CHAINS = (2, 4, 8, 15, 30, 60)
TURN = 5
Contest = dict[str, Callable[[], np.ndarray]]


def chain(n: int) -> tl.Robot:
    """A chain of n links of 1 m and 1 kg, bending in a plane."""
    link = '<inertial><origin xyz="0 0 -0.5"/><mass value="1"/><inertia ixx="0.084" iyy="0.084" izz="0.002" ' \
           'ixy="0" ixz="0" iyz="0"/></inertial>'  # fmt: skip
    parts = ['<link name="l0"/>']
    for i in range(1, n + 1):
        origin = "0 0 0" if i == 1 else "0 0 -1"
        parts.append(
            f'<link name="l{i}">{link}</link><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/>'
            f'<child link="l{i}"/><origin xyz="{origin}"/><axis xyz="0 1 0"/>'
            '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
        )
    return tl.load_robot(f'<robot name="chain{n}">{"".join(parts)}</robot>')


def robots(quick: bool) -> dict[str, tl.Robot]:
    found = {"arm": tl.load_robot("arm"), "ur5": tl.load_robot("ur5"), "panda": tl.load_robot("panda", lock=FINGERS)}
    if quick:
        return found | {"chain30": chain(30)}
    found |= {"anymal": tl.load_robot("anymal", root="free"), "talos": tl.load_robot("talos", root="free")}
    return found | {f"chain{n}": chain(n) for n in CHAINS}


def draw(robot: tl.Robot, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    few = [pin.integrate(robot.model, robot.neutral, s) for s in rng.uniform(-2, 2, (min(n, 2_000), robot.nv))]
    q = robot.normalize(np.resize(np.array(few), (n, robot.nq)))
    return q, rng.uniform(-2, 2, (n, robot.nv)), rng.uniform(-20, 20, (n, robot.nv))


def mujoco_model(robot: tl.Robot) -> mujoco.MjModel | None:
    """The same robot in MuJoCo from the same URDF, contacts, limits and damping off; None where it has no reading."""
    if robot.nq != robot.nv or robot.joint_names[0] == "root_joint":
        return None
    element = robot.visuals.text
    for joint in FINGERS:
        element = element.replace(f'name="{joint}" type="prismatic"', f'name="{joint}" type="fixed"')
    start = element.index(">") + 1
    text = (
        element[:start] + '<mujoco><compiler discardvisual="true" balanceinertia="false"/></mujoco>' + element[start:]
    )
    while "<visual" in text:
        a = text.index("<visual")
        text = text[:a] + text[text.index("</visual>", a) + 9 :]
    model = mujoco.MjModel.from_xml_string(text)
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT | off.mjDSBL_EULERDAMP
    model.dof_damping[:], model.dof_frictionloss[:], model.opt.timestep = 0, 0, 1e-4
    return model if model.nv == robot.nv else None


def forward_contest(robot: tl.Robot, q: np.ndarray, v: np.ndarray, w: np.ndarray) -> Contest:
    """Everyone's forward dynamics of the batch; the loops take a hundredth of it."""
    model, data, threads, n = robot.model, robot.model.createData(), thread_count(), len(q)
    pool, out = pin.ModelPool(model, threads), np.empty((robot.nv, n), order="F")
    columns = [np.ascontiguousarray(x.T).T for x in (q, v, w)]

    def parallel() -> np.ndarray:
        pin.abaInParallel(threads, pool, q.T, v.T, w.T, out)
        return out.T

    contest: Contest = {
        "pin.aba, loop": lambda: np.array([pin.aba(model, data, *s) for s in zip(*(x[: n // 100] for x in (q, v, w)))]),  # noqa: B905
        "pin.abaInParallel": parallel,
    }
    other = mujoco_model(robot)
    if other is not None:
        contest |= mujoco_contest(other, q, v, w, threads)
    contest["twolink, rows"] = lambda: robot.forward_dynamics(q, v, w, engine="compiled")
    contest["twolink, columns"] = lambda: robot.forward_dynamics(*columns, engine="compiled")
    return contest


def mujoco_contest(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, w: np.ndarray, threads: int) -> Contest:
    data = mujoco.MjData(model)
    few = max(1, len(q) // 100)

    def forward() -> np.ndarray:
        a = np.empty((few, model.nv))
        for i in range(few):
            data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q[i], v[i], w[i]
            mujoco.mj_forward(model, data)
            a[i] = data.qacc
        return a

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

    return {"mj_forward, loop": forward, "mujoco rollout, one step": rollout}


def inverse_contest(robot: tl.Robot, q: np.ndarray, v: np.ndarray, w: np.ndarray) -> Contest:
    threads = thread_count()
    pool, out = pin.ModelPool(robot.model, threads), np.empty((robot.nv, len(q)), order="F")
    columns = [np.ascontiguousarray(x.T).T for x in (q, v, w)]

    def parallel() -> np.ndarray:
        pin.rneaInParallel(threads, pool, q.T, v.T, w.T, out)
        return out.T

    return {
        "pin.rneaInParallel": parallel,
        "twolink, rows": lambda: robot.inverse_dynamics(q, v, w, engine="compiled"),
        "twolink, columns": lambda: robot.inverse_dynamics(*columns, engine="compiled"),
    }


def run(contest: Contest, rounds: int) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Median nanoseconds a state, and the answers; in every round everybody has TURN calls in a row."""
    answers = {name: call() for name, call in contest.items()}
    answers = {name: np.array(a) for name, a in answers.items()}
    times: dict[str, list[float]] = {name: [] for name in contest}
    for _ in range(rounds):
        for name, call in contest.items():
            call()
            for _ in range(TURN):
                start = time.perf_counter()
                call()
                times[name].append((time.perf_counter() - start) / len(answers[name]) * 1e9)
    return {name: statistics.median(t) for name, t in times.items()}, answers


def peak_flops(n: int = 200_000) -> float:
    """Operations a second of fused multiply-adds in independent chains, compiled the same way, all CPUs."""
    heyoka = kernels.heyoka()
    x = heyoka.expression("x")
    chains = [x + float(k) for k in range(8)]
    depth = 60
    for _ in range(depth):
        chains = [c * x + 0.25 for c in chains]
    compiled = heyoka.cfunc(chains, vars=[x])
    inputs, out = np.full((1, n), 0.5), np.empty((8, n))
    times = []
    for _ in range(15):
        start = time.perf_counter()
        compiled(inputs, outputs=out)
        times.append(time.perf_counter() - start)
    return 2 * depth * 8 * n / statistics.median(times)


def single_state(robots_: dict[str, tl.Robot]) -> None:
    print(f"\n{'one state, us':<12}{'pin.aba':>10}{'twolink':>10}{'compiled':>10}")
    for name, robot in robots_.items():
        q, v, w = (x[0] for x in draw(robot, 1))
        model, data = robot.model, robot.model.createData()
        calls = (lambda m=model, d=data, s=(q, v, w): pin.aba(m, d, *s),
                 lambda r=robot, s=(q, v, w): r.forward_dynamics(*s),
                 lambda r=robot, s=(q, v, w): r.forward_dynamics(*s, engine="compiled"))  # fmt: skip
        medians = []
        for call in calls:
            times = []
            for _ in range(25):
                start = time.perf_counter()
                for _ in range(400):
                    call()
                times.append((time.perf_counter() - start) / 400 * 1e6)
            medians.append(statistics.median(times))
        print(f"{name:<12}" + "".join(f"{m:>10.2f}" for m in medians))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--quick", action="store_true", help="arm, UR5, Panda and one chain only")
    options = parser.parse_args()
    peak, found, rows = peak_flops(), robots(options.quick), []
    print(f"{options.states} states, {thread_count()} threads, medians of {options.rounds} rounds; "
          f"fused multiply-adds run at {peak / 1e9:.1f} GFlop/s")  # fmt: skip
    for name, robot in found.items():
        q, v, w = draw(robot, options.states if robot.nv < 20 else options.states // 4)
        for query, contest in (("forward", forward_contest), ("inverse", inverse_contest)):
            robot.compiled().certificate(f"{query}_dynamics")
            times, answers = run(contest(robot, q, v, w), options.rounds)
            counts = kernels.count_operations(robot.model, functions.function(robot.model, f"{query}_dynamics"))
            operations = min(sum(c.values()) for c in counts)
            base = next(t for n, t in times.items() if n.endswith("InParallel"))
            truth = next(a for n, a in answers.items() if n.endswith("InParallel"))
            print(f"\n{name}, {query} dynamics: nv = {robot.nv}, {operations} operations")
            for contestant, ns in times.items():
                answer = answers[contestant]
                error = np.abs(answer - truth[: len(answer)]).max() / np.abs(truth).max()
                share = operations / ns / peak * 1e9 if contestant.startswith("twolink") else float("nan")
                shown = f"{100 * share:6.1f} % of peak" if share == share else ""
                print(f"  {contestant:<26}{ns:>10.1f} ns  {base / ns:>8.1f}x  agrees to {error:.0e} {shown}")
                rows.append([name, query, robot.nv, operations, contestant, ns, base / ns, error, share])
    single_state(found)
    OUT.mkdir(exist_ok=True)
    with (OUT / "bench_queries.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        header = ["robot", "query", "nv", "operations", "who", "ns", "times", "error", "share"]
        writer.writerows([header, *rows])
    picture(rows)
    print(f"\nwrote {OUT / 'bench_queries.csv'} and {OUT / 'bench_queries.png'}")


def picture(rows: list[list]) -> None:
    """Nanoseconds a state against degrees of freedom, one colour a contestant."""
    from matplotlib.ticker import NullLocator, ScalarFormatter

    from twolink.show.figure import COLOURS, new_figure, save_figure

    colour_of = {
        "pin.aba, loop": COLOURS[4], "pin.abaInParallel": COLOURS[0], "pin.rneaInParallel": COLOURS[0],
        "mj_forward, loop": "#BBBBBB", "mujoco rollout, one step": COLOURS[3],
        "twolink, rows": COLOURS[1], "twolink, columns": COLOURS[5],
    }  # fmt: skip
    figure, axes = new_figure(1, 2, size=(11, 4.8), sharey=True)
    for axis, query in zip(axes[0], ("forward", "inverse"), strict=True):
        for who in dict.fromkeys(r[4] for r in rows if r[1] == query):
            mine = [r for r in rows if r[1] == query and r[4] == who]
            chains = sorted((r[2], r[5]) for r in mine if r[0].startswith("chain"))
            others = [(r[2], r[5]) for r in mine if not r[0].startswith("chain")]
            if len(chains) > 1:
                axis.plot(*zip(*chains, strict=True), "-", color=colour_of[who], linewidth=1.5)
            axis.plot(*zip(*others, strict=True), "o", color=colour_of[who], label=who, markersize=5)
        axis.set(xscale="log", yscale="log", xlabel="degrees of freedom", title=f"{query} dynamics")
        axis.set_xticks([2, 4, 8, 15, 30, 60])
        axis.xaxis.set_major_formatter(ScalarFormatter())
        axis.xaxis.set_minor_locator(NullLocator())
        axis.legend(fontsize=8, frameon=False, loc="upper left")
    axes[0, 0].set_ylabel("nanoseconds a state")
    axes[0, 0].set_ylim(top=6e5)
    figure.suptitle("Batches of states: chains as lines; arm, UR5, Panda, ANYmal and Talos as dots", fontsize=11)
    save_figure(figure, OUT / "bench_queries.png")


if __name__ == "__main__":
    main()
