"""Environments in a batch beside MuJoCo's, at equal error: thousands of steps of a world a second.

python -m scripts.benchmarks.gym [--robot two_link,panda] [--worlds 16,256] [--error 1e-4,1e-8] [--rounds 7]

Random torques, held for 20 ms; both begin at the same states. The error is the largest distance of a world after a
second from one environment of ours at accuracy 1e-11. Each side takes its loosest setting below --error: ours of
accuracies, MuJoCo's of Euler, implicitfast and RK4 with steps that divide the period, the quickest of them. `sync` is
Gymnasium's SyncVectorEnv, `loop` the bare calls of mj_step, without observations, rewards and spaces.

The second table is of single environments, thousands of steps a second in episodes of 50, and errors after ten: the
arm, and a UR5 with stops and dry friction and Solo on its feet, both stepped. MuJoCo stands there at its default
(Euler, 2 ms), and at the setting that is quickest of those with no larger error than ours; where there is none, the
least error that it has. Errors are distances from events that are located, at accuracy 1e-9 (Solo's 1e-6).

The last lines are of `tl.Simulation`: its step beyond the compiled one, the least of all rounds, and a save and a
restore. Other times are of the processor, in one thread, medians after a warm-up.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import mujoco
import numpy as np

import twolink as tl
from scripts.mujoco_world import MujocoWorld
from scripts.runner import Bars, Some, Table, many, options, print_bars, seconds_of
from scripts.tasks import on_feet, robot_of
from twolink import effects as E
from twolink.gym import Environment, VectorEnvironment
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_control import initial_state
from twolink.integrate.steps.step_map import step_map

PERIOD, STEPS, JUDGED, FEW = 0.02, 50, 16, 10
ACCURACIES, PARTS = [10.0**-k for k in range(1, 11)], [2**k for k in range(10)]
INTEGRATORS = ("Euler", "implicitfast", "RK4")
OVERHEAD, SAVED = 10.0, 10.0  # us: a call of step beyond what is compiled, a save


def reward(state: Any, _: np.ndarray) -> float:
    """Of no importance."""
    return float(state.q[0])


class MujocoEnvironment(MujocoWorld, gymnasium.Env):
    """The same world by MuJoCo."""

    def __init__(self, scene: tl.Scene, integrator: str, parts: int) -> None:
        super().__init__(scene, PERIOD / parts, integrator)
        size, self.parts = self.model.nq + self.model.nv, parts
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.model.nv,))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), dtype=np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:  # noqa: ARG002
        gymnasium.Env.reset(self, seed=seed)
        self.begin()
        return np.concatenate([self.data.qpos, self.data.qvel]), {}

    def act(self, action: np.ndarray) -> None:
        """A period."""
        self.data.qfrc_applied[self.v_at] = action
        mujoco.mj_step(self.model, self.data, self.parts)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.act(action)
        return np.concatenate([self.data.qpos, self.data.qvel]), self.data.qpos[0], False, False, {}

    def after(self, actions: np.ndarray) -> np.ndarray:
        """q (nq,) in our order after the actions."""
        played(self, actions)
        return self.ours(self.data.qpos[None], self.data.qvel[None])[0]


def played(env: Any, actions: np.ndarray) -> np.ndarray:
    """q (worlds, nq), or (nq,), after the actions (steps, worlds, nv), or (steps, nv)."""
    env.reset(seed=0)
    for action in actions:
        seen = env.step(action)[0]
    return np.asarray(seen)[..., : actions.shape[-1]]


def compare(table: Table, name: str, worlds: int, error: float, rounds: int) -> float:
    """A row. Returns how many times as many steps ours makes as SyncVectorEnv."""
    robot = robot_of(name)
    scene = tl.Scene(robot, q=robot.normalize(robot.neutral), effects=[tl.effects.Gravity()], duration=1e6)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, worlds, robot.nv))
    common = {"period": PERIOD, "limit": 1.0}
    few, count = actions[:, :JUDGED], min(worlds, JUDGED)
    exact = [played(Environment(scene, reward, accuracy=1e-11, **common), few[:, i]) for i in range(count)]

    def batch(size: int, accuracy: float) -> VectorEnvironment:
        return VectorEnvironment(scene, reward, size, accuracy=accuracy, **common)

    def synced(kind: str, size: int, parts: int) -> gymnasium.vector.SyncVectorEnv:
        return gymnasium.vector.SyncVectorEnv([lambda: MujocoEnvironment(scene, kind, parts)] * size)

    def loosest(settings: list[Any], make: Callable[[Any], Any]) -> tuple[Any, float] | None:
        """The first setting whose error is below the bound, and its error."""
        errors = ((one, float(np.abs(played(make(one), few) - exact).max())) for one in settings)
        return next((found for found in errors if found[1] <= error), None)

    ours, theirs = loosest(ACCURACIES, partial(batch, count)), []
    for kind in INTEGRATORS:
        if found := loosest(PARTS, partial(synced, kind, count)):
            act = partial(MujocoEnvironment(scene, kind, found[0]).act, few[0, 0])
            theirs.append((seconds_of(act, rounds=99)[0], kind, *found))
    if not ours or not theirs:
        raise SystemExit(f"{name}: no setting of {'MuJoCo' if ours else 'ours'} has an error below {error:g}")
    _, kind, parts, their_error = min(theirs)
    env, sync = batch(worlds, ours[0]), synced(kind, worlds, parts)
    singles = [MujocoEnvironment(scene, kind, parts) for _ in range(worlds)]

    def loop() -> None:
        for one in singles:
            one.reset()
        for action in actions:
            for one, tau in zip(singles, action, strict=True):
                one.act(tau)

    taken = seconds_of(partial(played, env, actions), partial(played, sync, actions), loop, rounds=rounds,
                       clock=time.process_time)  # fmt: skip
    table.add(name, worlds, *(1e-3 * STEPS * worlds / one for one in taken), ours[1], their_error, f"{kind} / {parts}")
    return taken[1] / taken[0]


def environments() -> dict[str, tuple[tl.Scene, float, dict[str, Any], dict[str, Any]]]:
    """Scenes, the largest torques of the actions, ours, and what is exact."""
    arm, ur5, (solo, feet, _, contact) = robot_of("two_link"), robot_of("ur5"), on_feet("solo12")
    stops = [
        E.JointStops(dict.fromkeys(ur5.joint_names, (-1.0, 1.0))),
        E.DryFriction(dict.fromkeys(ur5.joint_names, 1.0)),
    ]
    exact = {"accuracy": 1e-9}
    return {
        "arm": (tl.Scene(arm, effects=[E.Gravity()], duration=1e6), 1.0, {}, exact),
        "ur5, stops": (tl.Scene(ur5, effects=[E.Gravity(), *stops], duration=1e6), 20.0,
                       {"contact": "stepped", "step": 2.5e-3}, exact),
        "solo12, feet": (tl.Scene(solo, feet, effects=[E.Gravity(), contact], duration=1e6), 0.2,
                         {"contact": "stepped", "step": 2e-3}, {"accuracy": 1e-6}),
    }  # fmt: skip


def single(table: Table, name: str, rounds: int) -> Bars:
    """A row of one environment, and its bars."""
    scene, limit, ours, exact = environments()[name]
    nv = scene.robot.nv
    driven = np.arange(nv) >= nv - sum(joint.v.stop - joint.v.start == 1 for joint in scene.robot.joints)
    actions = np.random.default_rng(0).uniform(-limit, limit, (STEPS, nv)) * driven

    def off(q: np.ndarray) -> float:
        return float(np.abs(scene.robot.difference(truth, q)).max())

    def after(env: Environment) -> np.ndarray:
        played(env, actions[:FEW])
        return env.simulation.state.q

    env, reference = (Environment(scene, reward, period=PERIOD, limit=limit, **one) for one in (ours, exact))
    truth = after(reference)
    error, default = off(after(env)), MujocoEnvironment(scene, "Euler", 10)
    worlds = [MujocoEnvironment(scene, kind, parts) for kind in INTEGRATORS for parts in PARTS]
    errors = [off(world.after(actions[:FEW])) for world in worlds]
    equal = [world for world, one in zip(worlds, errors, strict=True) if one <= error]
    calls = [partial(played, one, actions) for one in (env, default, *equal)]
    rate, usual, *rates = (1e-3 * STEPS / one for one in seconds_of(*calls, rounds=rounds, clock=time.process_time))
    table.add(name, rate, error, usual, off(default.after(actions[:FEW])), max(rates, default=None), min(errors))
    equally = f"{rate / max(rates):.2f} times MuJoCo's steps at equal error" if rates else "MuJoCo has no such error"
    return [(rate >= max(rates, default=0.0), f"{name}: {equally}"),
            (rate >= 0.5 * usual, f"{name}: {rate / usual:.3f} times MuJoCo's steps at its default")]  # fmt: skip


def saves() -> Bars:
    """What a save and a restore cost."""
    sim = tl.Simulation(tl.load_scene("arm-swing"))
    sim.step(1e-3)
    saved = sim.save()
    calls = (many(call, 500) for call in (sim.save, partial(sim.restore, saved)))
    each = [2e3 * one for one in seconds_of(*calls, rounds=99, clock=time.process_time, pick=min)]
    return [(one <= SAVED, f"{what}: {one:.1f} us") for what, one in zip(("save", "restore"), each, strict=True)]


def overhead(rounds: int) -> float:
    """us of a call of step beyond one compiled step."""
    sim, tau = tl.Simulation(tl.load_scene("arm-swing")), np.array([0.1, 0.2])
    sim.step(1e-3, tau)
    by = step_map(sim._motion.equations, METHODS["dop853"])
    states = np.repeat(initial_state(by.equations.start[:, None], 0.0, 1e-3, 1.0, 1e-9)[None], 2, axis=0)
    calls = partial(sim.step, 1e-3, tau), partial(by.attempts, states, 1, 1)
    taken = seconds_of(*(many(call, 200) for call in calls), rounds=9 * rounds, clock=time.process_time, pick=min)
    whole, bare = (5e3 * one for one in taken)
    print(f"step {whole:.1f} us, compiled {bare:.1f} us")
    return whole - bare


def main() -> int:
    given = options(__doc__, robot=Some(("two_link", "panda")), worlds=(16, 256), error=(1e-4, 1e-8), rounds=7)
    table = Table("robot <9 | worlds >6 | ours k/s >9.1f | MuJoCo sync >9.1f | MuJoCo loop >9.1f | our error >9.1e | "
                  "MuJoCo's >9.1e | integrator / steps <18")  # fmt: skip
    mujoco.set_mju_user_warning(lambda _: None)  # of steps that are too long, which are not taken
    cases = [(name, worlds, error) for name in given.robot for worlds in given.worlds for error in given.error]
    bars = []
    for name, worlds, error in cases:
        more = compare(table, name, worlds, error, given.rounds)
        bars.append((more >= 1.0, f"{name}, {worlds} worlds, {error:g}: {more:.1f} times MuJoCo's steps"))
    print()
    table = Table("environment <12 | ours k/s >8.3f | our error >9.1e | MuJoCo's default k/s >8.3f | its error >9.1e | "
                  "at equal error k/s >8.3f | MuJoCo's least error >9.1e")  # fmt: skip
    for name in environments():
        bars += single(table, name, given.rounds)
    beyond = overhead(given.rounds)
    return not print_bars([*bars, *saves(), (beyond <= OVERHEAD, f"step: {beyond:.1f} us beyond its compiled step")])


if __name__ == "__main__":
    raise SystemExit(main())
