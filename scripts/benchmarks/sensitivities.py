"""Sensitivities: what they cost beside the motion, and beside heyoka's variational equations and MuJoCo's differences.

Every price is the least processor time of several runs, in turn. `error` is the largest distance to sensitivities that
were asked for at 1e-11, relative to the largest entry. heyoka's var_ode_sys takes the tolerance that gives no larger an
error than ours; MuJoCo's RK4 takes central differences with the time step, down to 1e-4 s, that comes nearest.

    python -m scripts.benchmarks.sensitivities [--scenes arm-swing,panda] [--accuracy 1e-6] [--runs 7] [--no-peers]
"""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

import twolink as tl
from scripts.heyoka_peer import heyoka, system_of
from scripts.runner import once, options, seconds_of
from scripts.tasks import robot_of
from twolink.integrate.motion.scene_equations import equations_of

DIFFERENCE = 1e-5  # rad, rad/s: of MuJoCo's starts
cheapest = partial(seconds_of, warm_up=0, clock=time.process_time, pick=min)


def scene_of(name: str) -> tl.Scene:
    """A bundled scene; "panda": the arm alone, falling from a bent posture, which all peers can simulate."""
    if name != "panda":
        return tl.load_scene(name)
    return tl.Scene(
        robot_of("panda"), [0.1, -0.6, 0.2, -2.0, 0.1, 1.5, 0.4], effects=[tl.effects.Gravity()], duration=1.0
    )


def matrix(s: tl.Sensitivities) -> np.ndarray:
    """d(q, v)/d(q0, v0) at the samples, (n, 2 nv, 2 nv)."""
    return np.concatenate([np.concatenate([s.q[x], s.v[x]], axis=1) for x in ("q", "v")], axis=2)


def distance(s: np.ndarray, exact: np.ndarray) -> float:
    """The largest error, relative to the largest entry."""
    return float(np.abs(s - exact).max() / np.abs(exact).max())


def by_heyoka(scene: tl.Scene, times: np.ndarray, tolerance: float) -> Callable[[], np.ndarray]:
    """heyoka's variational equations, compiled; a call solves them."""
    module, equations = heyoka(), equations_of(scene)
    size = equations.moving
    system = module.var_ode_sys(system_of(equations), module.var_args.vars, order=1)
    integrator = module.taylor_adaptive(system, equations.start[:size].tolist(), tol=tolerance, compact_mode=True)
    integrator.pars[:] = equations.start[size:][: len(integrator.pars)]
    start = integrator.state.copy()

    def solve() -> np.ndarray:
        integrator.time, integrator.state[:] = 0.0, start
        states = integrator.propagate_grid(times)[-1]
        return np.asarray(states[:, size:].reshape(-1, size, size))

    return solve


def by_mujoco(scene: tl.Scene, times: np.ndarray, step: float) -> Callable[[], np.ndarray]:
    """Central differences of MuJoCo's runs with RK4."""
    from twolink.hard.peers import mujoco_peer
    from twolink.hard.peers.task import PeerRun, Setting, task_of

    def moved(change: np.ndarray) -> Callable[[], PeerRun]:
        dq, dv = np.split(change, 2)
        other = tl.Scene(scene.base, scene.q + dq, scene.v + dv, scene.effects, scene.duration)
        return mujoco_peer.prepare(task_of(other, times), Setting("RK4", "", step=step))

    def states(run: Callable[[], PeerRun]) -> np.ndarray:
        track = run().track
        return np.concatenate([track.q, track.v], axis=1) / (2 * DIFFERENCE)

    pairs = [(moved(d), moved(-d)) for d in DIFFERENCE * np.eye(2 * scene.robot.nv)]
    return lambda: np.stack([states(more) - states(less) for more, less in pairs], axis=2)


def compare(name: str, accuracy: float, runs: int, *, peers: bool) -> None:
    """The lines of one scene."""
    scene = scene_of(name)
    exact = matrix(tl.sensitivities(scene, wrt=["q", "v"], accuracy=1e-11))
    differentiate = partial(tl.sensitivities, scene, wrt=["q", "v"], accuracy=accuracy)
    first, s = once(differentiate)
    ours, motion = cheapest(differentiate, partial(tl.simulate, scene, accuracy=accuracy), rounds=runs)
    print(f"{name}, accuracy {accuracy:g}: motion {motion * 1e3:.2f} ms ({s.run.cost.method})")

    def line(who: str, price: float, error: float, more: str) -> None:
        print(f"  {who:<8} {price * 1e3:9.2f} ms  {price / motion:7.1f} x the motion  error {error:.1e}, {more}")

    error = distance(matrix(s), exact)
    bar = max(float(s.error[x][-1]) for x in s.error) / np.abs(exact).max()
    line("twolink", ours, error, f"bar {bar:.1e}, first answer {first:.2f} s")
    if not peers:
        return
    if equations_of(scene).breaks(scene.duration) or equations_of(scene).has_events:
        print("  peers differentiate smooth motions only")
        return
    times, tolerance, off = s.run.t, 100 * max(accuracy, 1e-14), np.inf
    while off > error and tolerance > 1e-14:
        tolerance /= 100
        built, solve = once(partial(by_heyoka, scene, times, tolerance))
        off = distance(solve(), exact)
    line("heyoka", cheapest(solve, rounds=runs)[0], off, f"no bar, compiled in {built:.1f} s")
    step, off = 5 * float(times[1]), np.inf
    while off > error and step > 2e-4:
        step /= 5
        solve = by_mujoco(scene, times, step)
        off = distance(solve(), exact)
    line("MuJoCo", cheapest(solve, rounds=1)[0], off, f"no bar, steps of {step:g} s")


def main() -> None:
    given = options(__doc__, scenes=("arm-swing", "panda"), accuracy=1e-6, runs=7, no_peers=False)
    for name in given.scenes:
        compare(name, given.accuracy, given.runs, peers=not given.no_peers)


if __name__ == "__main__":
    main()
