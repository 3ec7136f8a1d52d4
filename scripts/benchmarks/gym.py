"""Environments in a batch beside MuJoCo's, at equal error: thousands of steps of a world a second.

python -m scripts.benchmarks.gym [--robot two_link,panda] [--worlds 16,256] [--error 1e-4,1e-8] [--rounds 7]

Random torques, held for 20 ms; both begin at the same states. The error is the largest distance of a world after a
second from one environment of ours at accuracy 1e-11. Each side takes its loosest setting below --error: ours of
accuracies, MuJoCo's of Euler, implicitfast and RK4 with steps that divide the period, the quickest of them. `sync` is
Gymnasium's SyncVectorEnv, `loop` the bare calls of mj_step, without observations, rewards and spaces. The last lines
are of `tl.Simulation.step` beyond its compiled step, the least of all rounds. Other times are of the processor, in one
thread, medians after a warm-up.
"""

import time
from collections.abc import Callable
from typing import Any

import gymnasium
import mujoco
import numpy as np

import twolink as tl
from scripts.runner import FINGERS, Some, Table, options, print_bars, seconds_of
from twolink.gym import Environment, VectorEnvironment
from twolink.hard.peers import mujoco_peer
from twolink.hard.peers.task import task_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_control import initial_state
from twolink.integrate.steps.step_map import step_map

PERIOD, STEPS, JUDGED = 0.02, 50, 16
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
PARTS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
INTEGRATORS = {"Euler": mujoco.mjtIntegrator.mjINT_EULER, "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
               "RK4": mujoco.mjtIntegrator.mjINT_RK4}  # fmt: skip
OVERHEAD = 10.0  # us a call of step, beyond what is compiled


def reward(state: Any, _: np.ndarray) -> float:
    """Of no importance."""
    return float(state.q[0])


class MujocoWorld(gymnasium.Env):
    """The same world by MuJoCo. q (nq,) at the start."""

    def __init__(self, scene: tl.Scene, integrator: str, parts: int) -> None:
        self.model = mujoco_peer.build(task_of(scene, np.array([0.0, PERIOD])))
        self.model.opt.timestep, self.model.opt.integrator = PERIOD / parts, INTEGRATORS[integrator]
        self.data, self.parts, self.start = mujoco.MjData(self.model), parts, scene.q
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.model.nv,))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2 * self.model.nv,), dtype=np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:  # noqa: ARG002
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.start
        return np.concatenate([self.data.qpos, self.data.qvel]), {}

    def act(self, action: np.ndarray) -> None:
        """A period."""
        self.data.qfrc_applied[:] = action
        mujoco.mj_step(self.model, self.data, self.parts)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.act(action)
        return np.concatenate([self.data.qpos, self.data.qvel]), self.data.qpos[0], False, False, {}


def played(env: Any, actions: np.ndarray) -> np.ndarray:
    """q (worlds, nq) after the actions (steps, worlds, nv)."""
    env.reset(seed=0)
    for action in actions:
        seen = env.step(action)[0]
    return np.asarray(seen)[:, : actions.shape[2]]


def loosest(makers: dict[Any, Callable[[], Any]], actions: np.ndarray, exact: np.ndarray, error: float) -> Any:
    """The first setting whose error is below a bound, and the error; None where there is none."""
    for setting, make in makers.items():
        off = float(np.abs(played(make(), actions) - exact).max())
        if off <= error:
            return setting, off
    return None


def compare(table: Table, name: str, worlds: int, error: float, rounds: int) -> float:
    """A row. Returns how many times as many steps ours makes as SyncVectorEnv."""
    robot = tl.load_robot(name, lock=FINGERS if name == "panda" else None)
    scene = tl.Scene(robot, q=robot.normalize(robot.neutral), effects=[tl.effects.Gravity()], duration=1e6)
    random = np.random.default_rng(0)
    actions = random.uniform(-1.0, 1.0, (STEPS, worlds, robot.nv))
    few = actions[:, :JUDGED]
    count, common = few.shape[1], {"period": PERIOD, "limit": 1.0}
    exact = np.array([played_alone(Environment(scene, reward, accuracy=1e-11, **common), few[:, i])
                      for i in range(count)])  # fmt: skip
    ours = loosest({a: lambda a=a: VectorEnvironment(scene, reward, count, accuracy=a, **common) for a in ACCURACIES},
                   few, exact, error)  # fmt: skip
    theirs = []
    for kind in INTEGRATORS:
        makers = {n: lambda n=n, kind=kind: synced(scene, kind, n, count) for n in PARTS}
        found = loosest(makers, few, exact, error)
        if found:
            one = MujocoWorld(scene, kind, found[0])
            theirs.append((seconds_of(lambda one=one: one.act(few[0, 0]), rounds=99)[0], kind, *found))
    if not ours or not theirs:
        raise SystemExit(f"{name}: no setting of {'MuJoCo' if ours else 'ours'} has an error below {error:g}")
    _, kind, parts, their_error = min(theirs)
    env, sync = VectorEnvironment(scene, reward, worlds, accuracy=ours[0], **common), synced(scene, kind, parts, worlds)

    singles = [MujocoWorld(scene, kind, parts) for _ in range(worlds)]

    def loop() -> None:
        for one in singles:
            one.reset()
        for action in actions:
            for one, tau in zip(singles, action, strict=True):
                one.act(tau)

    calls = (lambda: played(env, actions), lambda: played(sync, actions), loop)
    taken = seconds_of(*calls, rounds=rounds, clock=time.process_time)
    mine, synced_rate, bare = (1e-3 * STEPS * worlds / one for one in taken)
    table.add(name, worlds, mine, synced_rate, bare, ours[1], their_error, f"{kind} / {parts}")
    return mine / synced_rate


def played_alone(env: Any, actions: np.ndarray) -> np.ndarray:
    """q (nq,) of one world."""
    env.reset(seed=0)
    for action in actions:
        seen = env.step(action)[0]
    return seen[: actions.shape[1]]


def synced(scene: tl.Scene, kind: str, parts: int, worlds: int) -> gymnasium.vector.SyncVectorEnv:
    """MuJoCo's worlds."""
    return gymnasium.vector.SyncVectorEnv([lambda: MujocoWorld(scene, kind, parts)] * worlds)


def overhead(rounds: int) -> float:
    """us of a call of step beyond one compiled step."""
    sim, tau = tl.Simulation(tl.load_scene("arm-swing")), np.array([0.1, 0.2])
    sim.step(1e-3, tau)
    by = step_map(sim._motion.equations, METHODS["dop853"])
    state = initial_state(sim._motion.x[:, :1], 0.0, 1e-3, 1.0, 1e-9)
    out = np.empty_like(state)

    def calls(call: Callable[[], object]) -> Callable[[], object]:
        return lambda: [call() for _ in range(200)]

    compiled = calls(lambda: by(state, out))
    whole, bare = seconds_of(
        calls(lambda: sim.step(1e-3, tau)), compiled, rounds=9 * rounds, clock=time.process_time, pick=min
    )
    print(f"step {5e3 * whole:.1f} us, compiled {5e3 * bare:.1f} us")
    return 5e3 * (whole - bare)


def main() -> None:
    given = options(__doc__, robot=Some(("two_link", "panda")), worlds=(16, 256), error=(1e-4, 1e-8), rounds=7)
    table = Table("robot <9 | worlds >6 | ours k/s >9.1f | MuJoCo sync >9.1f | MuJoCo loop >9.1f | our error >9.1e | "
                  "MuJoCo's >9.1e | integrator / steps <18")  # fmt: skip
    mujoco.set_mju_user_warning(lambda _: None)  # of steps that are too long, which are not taken
    bars = []
    for name in given.robot:
        for worlds in given.worlds:
            for error in given.error:
                more = compare(table, name, worlds, error, given.rounds)
                bars.append((more >= 1.0, f"{name}, {worlds} worlds, {error:g}: {more:.1f} times MuJoCo's steps"))
    beyond = overhead(given.rounds)
    bars.append((beyond <= OVERHEAD, f"step: {beyond:.1f} us beyond its compiled step"))
    raise SystemExit(0 if print_bars(bars) else 1)


if __name__ == "__main__":
    main()
