"""tl.fit on simulated measurements: do the stated intervals hold, and what a plain fit says instead.

    python scripts/bench_fit.py [--repetitions 100] [--noise 2e-3] [--plain] [--no-coverage]

Coverage: an arm that falls with damping, 3 s of noisy joint angles. In how many repetitions are the true values inside
their 95 % intervals?
--plain: two cases in which a plain fit by simulation (scipy.optimize.least_squares; mujoco.minimize.least_squares, the
solver of MuJoCo's sysid; both on Pinocchio's forward dynamics and SciPy's DOP853) ends without a warning at values that
mean nothing: a double pendulum that goes over its top, and masses of which only the ratio acts.
"""

import argparse
import time
from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import twolink as tl
from twolink.scenes.parameters import scene_with

ARM = {"forearm.mass": 1.9, "effects.1.damping.elbow": 0.25, "effects.1.damping.shoulder": 0.4, "q.elbow": 0.72}


def noisy(values: np.ndarray, size: float, seed: int) -> np.ndarray:
    return values + size * np.random.default_rng(seed).standard_normal(values.shape)


def coverage(repetitions: int, noise: float) -> None:
    """The share of true values inside their intervals."""
    effects = [tl.effects.Gravity(), tl.effects.JointDamping({"shoulder": 0.3, "elbow": 0.2})]
    robot, times = tl.load_robot("arm"), np.linspace(0.0, 3.0, 151)
    guess = tl.Scene(robot, [1.0, 0.7], effects=effects)
    truth = scene_with(tl.Scene(robot, [1.0, ARM["q.elbow"]], effects=effects),
                        {name: value for name, value in ARM.items() if name != "q.elbow"})  # fmt: skip
    q, _ = tl.simulate(truth, 3.0, 1e-10).at(times)
    inside, start = [], time.process_time()
    for seed in range(repetitions):
        found = tl.fit(guess, {"t": times, "q": noisy(q, noise, seed)}, list(ARM))
        inside.append([low <= ARM[name] <= high for name, (low, high) in found.intervals.items()])
    table, seconds = np.array(inside), (time.process_time() - start) / repetitions
    each = ", ".join(f"{name} {share:.3f}" for name, share in zip(ARM, table.mean(axis=0), strict=False))
    print(f"coverage: {table.mean():.4f} of {table.size} intervals of 95 % ({each}); {seconds:.2f} cpu s a fit")


def plain(title: str, scene: tl.Scene, true: Mapping[str, float], change: Callable[[pin.Model, np.ndarray], None],
          names: list[str], duration: float) -> None:  # fmt: skip
    """A plain fit of two numbers that `change` sets in a model, beside ours of `names`."""
    times = np.linspace(0.0, duration, int(50 * duration) + 1)
    q, _ = tl.simulate(scene_with(scene, true), duration, 1e-9).at(times)
    measured = noisy(q, 1e-3, 0)

    def residuals(x: np.ndarray) -> np.ndarray:
        model = scene.robot.model.copy()
        change(model, np.asarray(x).ravel())
        data, nq = model.createData(), model.nq

        def rate(_t: float, state: np.ndarray) -> np.ndarray:
            return np.concatenate([state[nq:], pin.aba(model, data, state[:nq], state[nq:], np.zeros(model.nv))])

        start = np.concatenate([scene.q, scene.v])
        run = solve_ivp(rate, (0.0, duration), start, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-9)
        return np.asarray((run.y[:nq].T - measured).ravel())

    print(f"\n{title}; true {dict(true)}")
    found = least_squares(residuals, [1.0, 1.0], diff_step=1e-6)
    print(f"  scipy least_squares     factors {found.x.round(4).tolist()}, status {found.status}: {found.message}")
    try:
        from mujoco import minimize

        def batch(x: np.ndarray) -> np.ndarray:
            return np.stack([residuals(column) for column in x.T], axis=1)

        x, trace = minimize.least_squares(np.ones((2, 1)), batch, verbose=minimize.Verbosity.SILENT)
        print(f"  mujoco.minimize         factors {np.ravel(x).round(4).tolist()}, {len(trace)} iterations, no warning")
    except ImportError:
        print("  mujoco.minimize         not installed")
    print(f"  twolink: {tl.fit(scene, {'t': times, 'q': measured}, names)}")


def plain_cases() -> None:
    """Factors of the guess that a plain fit finds, and ours."""
    gravity = [tl.effects.Gravity()]

    def mass_and_gravity(model: pin.Model, x: np.ndarray) -> None:
        body = model.inertias[2]
        model.inertias[2] = pin.Inertia(float(body.mass * x[0]), body.lever, body.inertia)
        model.gravity.linear = model.gravity.linear * x[1]

    def scales(model: pin.Model, x: np.ndarray) -> None:
        for i, factor in zip((1, 2), np.abs(x), strict=True):
            body = model.inertias[i]
            model.inertias[i] = pin.Inertia(float(body.mass * factor), body.lever, body.inertia * float(factor))

    pendulum = tl.Scene(tl.load_robot("two_link"), [1.5, 1.0], [4.0, 0.0], gravity)
    mass = float(pendulum.robot.model.inertias[2].mass)
    plain("Over the top (factors 1.1 and 0.9684 of mass and gravity)", pendulum,
          {"forearm.mass": 1.1 * mass, "gravity.z": -9.5}, mass_and_gravity, ["forearm.mass", "gravity.z"],
          8.0)  # fmt: skip
    arm = tl.Scene(tl.load_robot("arm"), [1.0, 0.7], effects=gravity)
    bodies = [arm.robot.model.inertias[i] for i in (1, 2)]
    heavier = {}
    for link, body, factor in zip(("upper_arm", "forearm"), bodies, (2.0, 3.0), strict=True):
        heavier[f"{link}.mass"] = factor * body.mass
        heavier |= {f"{link}.inertia.{axis}{axis}": factor * float(body.inertia[i, i]) for i, axis in enumerate("xyz")}
    plain("Links of unknown mass (factors 2 and 3)", arm, heavier, scales, ["upper_arm.*", "forearm.*"], 2.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument("--noise", type=float, default=2e-3, help="of the angles, rad")
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--no-coverage", action="store_true")
    options = parser.parse_args()
    if not options.no_coverage:
        coverage(options.repetitions, options.noise)
    if options.plain:
        plain_cases()


if __name__ == "__main__":
    main()
