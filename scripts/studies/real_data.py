"""Held-out torques of real robots: the default of `tl.identify` beside its options, other fits and published values.

    python -m scripts.studies.real_data [--panda FOLDER] [--ur10e FOLDER] [--tx40 FOLDER] [--twin] [--parts] [--fit]

pendulum: fitted on runs 00, 02 and 04 of tests/parts/identification/double_pendulum, judged on run 12. The others are
read from the user's copy, as their licences do not allow ours. panda: the first 14 s of matlab/data/Exciting_Traj/
Trajectory_1/rbt_log of github.com/marcocognetti/FrankaEmikaPandaDynModel (GPL 3; Gaz et al., IEEE RA-L 4(4), 2019),
judged on the rest. ur10e: ur-20_02_10-30sec_12harm.csv, judged on ur-20_02_12-40sec_12harm.csv, with ur10e.urdf, of
github.com/shamilmamedov/dynamic_calibration (no licence); currents times the drive gains below. tx40: the first 70 % of
pos_read_data.csv and curr_data.csv, judged on the rest, with tx40_mdh_modified.urdf, of
github.com/thanhndv212/figaroh-examples. twin: simulated logs of a Panda as `scripts.studies.intervals` has them;
published is then the truth, but for offset, delay and drift.

Root mean square of the measured torques less their prediction by joint, N m, and of all in % of the torques', all with
the same states, filtered at 6 Hz (ur10e 10, tx40 30). The options: joint models for all joints, a robust fit, no delay,
cut-offs. by hand: base parameters and friction by NumPy's least squares, filtered with 8 Hz (tx40 30). published: the
pendulum's authors' parameters; of the Panda, those of its URDF. figaroh: its regressor and base parameters, with
friction, rotors and the same filter, where it is installed.

--parts: each log in disjoint halves, fitted alone: how many of the parameters that both tell differ by more than 1.96
standard errors of the difference; at most 15 %. --fit: `tl.fit` on a second of run 00, driven by a table of 100 torques
for each joint, from the URDF's values: 12 unknowns, under 15 s of the processor. Otherwise ends 0 if the default is
within 5 % of every other row. Rows go to out/real-data.csv.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import twolink as tl
import twolink.effects as fx
from scripts.runner import TOP, Bars, Table, once, study
from scripts.studies.intervals import DRIVES, recorded
from scripts.tasks import robot_of
from twolink.parts.identification.base_parameters import base_parameters, select
from twolink.parts.identification.filtering import Recording, States, half_window_of, states

LOGS = TOP / "tests" / "parts" / "identification" / "double_pendulum"
PUBLISHED = {"Link1.first_moment.z": -0.5594 * 0.3, "Link1.origin_inertia.xx": 0.05347, "Link2.mass": 0.6043,
             "Link2.first_moment.z": 0.6043 * 0.1838, "Link2.origin_inertia.xx": 0.02392,
             **{f"Joint{k}.armature": 36 * 7.66e-5 for k in (1, 2)}, **{f"Joint{k}.damping": 0.001 for k in (1, 2)},
             "Joint1.friction": 0.093, "Joint2.friction": 0.078}  # fmt: skip
SHARE, SECONDS, WORSE = 0.15, 15.0, 1.05
OPTIONS: dict[str, dict[str, Any]] = {
    "none": {"joint_model": "none"}, "viscous+coulomb": {"joint_model": "viscous+coulomb"},
    "with rotor": {"joint_model": "viscous+coulomb+rotor"},
    "with rotor, offset": {"joint_model": "viscous+coulomb+rotor+offset"},
    "with rotor, offset, stribeck": {"joint_model": "viscous+coulomb+rotor+offset+stribeck"},
    "robust": {"method": "robust"}, "no delay": {"find": ()}, "4 Hz": {"cutoff": 4.0}, "15 Hz": {"cutoff": 15.0},
}  # fmt: skip
GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])  # N m/A, of the drives of a UR10e
RATIOS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0]) + 32.0 * np.eye(6)[5][:, None] * np.eye(6)[4]  # of a TX40
Predict = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Row:
    """Residuals of one way by joint, N m, in % of the torques'; parts: how many values, and off."""

    way: str
    left: str
    percent: str = ""
    size: float = 0.0


@dataclass(frozen=True)
class Logs:
    """A robot, its runs, the one that is held out, and the parameters that were published; the filters, Hz."""

    robot: tl.Robot
    runs: list[Recording]
    held: Recording
    published: np.ndarray | None
    judged: float = 6.0
    fitted: float = 8.0


def pendulum() -> Logs:
    def run(number: str) -> Recording:
        with np.load(LOGS / f"run_{number}.npz") as log:
            return Recording(log["t"], log["q"].astype(float), None, None, log["tau"].astype(float))

    robot = tl.load_robot(LOGS / "double_pendulum.urdf")
    published = np.array([PUBLISHED.get(name, 0.0) for name in robot.parameter_names])
    return Logs(robot, [run(number) for number in ("00", "02", "04")], run("12"), published)


def panda(folder: Path) -> Logs:
    read = {name: np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7 if name != "time" else 1)[::4]
            for name in ("time", "positions", "torques")}  # fmt: skip
    t = read["time"][:, 0]
    new = np.append(True, np.diff(t) > 0)
    t, q, tau = t[new], read["positions"][new], read["torques"][new]
    fitted, held = (Recording(t[rows], q[rows], None, None, tau[rows]) for rows in (t < 14.0, t >= 14.0))
    robot = robot_of("panda")
    return Logs(robot, [fitted], held, robot.parameter_values)


def ur10e(folder: Path) -> Logs:
    def run(name: str) -> Recording:
        log = np.loadtxt(folder / f"ur-20_02_{name}.csv", delimiter=",")
        log = log[np.append(True, np.diff(log[:, 0]) > 0)]
        return Recording(log[:, 0] - log[0, 0], log[:, 1:7], log[:, 7:13], None, log[:, 13:19] * GAINS)

    return Logs(tl.load_robot(folder / "ur10e.urdf"), [run("10-30sec_12harm")], run("12-40sec_12harm"), None, 10.0)


def tx40(folder: Path) -> Logs:
    turned, current = (
        np.loadtxt(folder / f"{name}_data.csv", delimiter=",", skiprows=1) for name in ("pos_read", "curr")
    )
    q, tau = turned @ np.linalg.inv(RATIOS).T + np.pi / 2 * np.array([0, -1, 1, 0, 0, 0]), current @ RATIOS
    t, cut = 2e-4 * np.arange(len(q)), 7 * len(q) // 10
    fitted, held = (Recording(t[rows], q[rows], None, None, tau[rows]) for rows in (slice(cut), slice(cut, None)))
    robot = tl.load_robot(folder / "tx40_mdh_modified.urdf", purpose="identification")
    return Logs(robot, [fitted], held, None, 30.0, 30.0)


def twin() -> Logs:
    """Two motions of a Panda with friction, delay, drift and quantised encoders and torques."""
    robot, logs = robot_of("panda"), [recorded("panda", np.random.default_rng(k), seed=k) for k in (0, 1)]
    fitted, held = (Recording(log["t"], log["q"], None, None, log["tau"]) for log in logs)
    known = zip(robot.parameter_names, robot.parameter_values, strict=True)
    truth = np.array([DRIVES.get(name.rpartition(".")[2], value) for name, value in known])
    return Logs(robot, [fitted], held, truth)


def table_of(run: Recording) -> dict[str, np.ndarray]:
    return {"t": run.t, "q": run.q, "tau": run.tau} | ({} if run.v is None else {"v": run.v})


def filtered(robot: tl.Robot, run: Recording, cutoff: float) -> tuple[States, np.ndarray]:
    """States filtered at a frequency, Hz, and the torques there."""
    half = half_window_of(cutoff, (len(run.t) - 1) / (run.t[-1] - run.t[0]))
    at = np.arange(half, len(run.t) - half)
    return states(robot, run, half, "q", at), run.tau[at]


def by_hand(logs: Logs) -> Predict:
    """Base parameters, and each joint's offset where the model has it, by least squares."""
    robot, chosen = logs.robot, select(logs.robot, ["*"])
    used = chosen.columns[:, list(base_parameters(robot, chosen).members)]

    def columns(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        offsets = np.broadcast_to(np.eye(robot.nv), (len(q), robot.nv, robot.nv))
        return np.concatenate([robot.regressor(q, v, a) @ used, offsets], 2)

    systems = [filtered(robot, run, logs.fitted) for run in logs.runs]
    left = np.concatenate([np.concatenate(columns(now.q, now.v, now.a)) for now, _ in systems])
    found = np.linalg.lstsq(left, np.concatenate([tau.ravel() for _, tau in systems]), rcond=None)[0]
    return lambda q, v, a: columns(q, v, a) @ found


def figaroh(logs: Logs) -> Predict:
    """The base parameters that figaroh finds, of its own regressor."""
    from figaroh.tools.qrdecomposition import QRDecomposer
    from figaroh.tools.regressor import RegressorBuilder, RegressorConfig

    model, n = logs.robot.model, logs.robot.nv
    config = RegressorConfig(has_friction=True, has_actuator_inertia=True, has_joint_offset=True)
    builder = RegressorBuilder(SimpleNamespace(model=model, data=model.createData()), config)
    drives = {"act_idxv": range(n)}
    systems = [filtered(logs.robot, run, logs.fitted) for run in logs.runs]
    left = np.vstack([builder.build_basic_regressor(now.q, now.v, now.a, drives) for now, _ in systems])
    used, by = np.flatnonzero(np.sum(left**2, axis=0) > 1e-6), QRDecomposer()
    tau = np.concatenate([tau.T.ravel() for _, tau in systems])  # joint by joint
    found = by.double_decomposition(tau, left[:, used], [str(k) for k in used])[3]
    base = used[by.base_indices]
    return lambda q, v, a: (builder.build_basic_regressor(q, v, a, drives)[:, base] @ found).reshape(n, -1).T


LOADED: dict[str, Callable[[Path], Logs]] = {"panda": panda, "ur10e": ur10e, "tx40": tx40}


def ways(given: argparse.Namespace) -> list[str]:
    sets = [name for name in ("pendulum", *LOADED, "twin") if name == "pendulum" or getattr(given, name)]
    if given.fit:
        return ["pendulum, fit"]
    each = ["parts"] if given.parts else ["default", *OPTIONS, "by hand", "published",
                                          *(["figaroh"] if find_spec("figaroh") else [])]  # fmt: skip
    return [f"{name}, {way}" for name in sets for way in each if name not in ("ur10e", "tx40") or way != "published"]


def rows_of(key: str, given: argparse.Namespace) -> Iterator[Row]:
    """The residuals of a way."""
    name, _, way = key.partition(", ")
    if way == "fit":
        yield Row(key, *simulated())
        return
    logs = LOADED[name](Path(getattr(given, name))) if name in LOADED else {"pendulum": pendulum, "twin": twin}[name]()
    if way == "parts":
        yield Row(key, *parts(logs))
        return
    predict: Predict
    if way in ("by hand", "figaroh"):
        predict = (figaroh if way == "figaroh" else by_hand)(logs)
    elif way == "published":
        predict = lambda q, v, a: logs.robot.regressor(q, v, a) @ np.asarray(logs.published)  # noqa: E731
    else:
        predict = tl.identify(logs.robot, [*map(table_of, logs.runs)], **OPTIONS.get(way, {})).predict
    now, tau = filtered(logs.robot, logs.held, logs.judged)
    left = np.sqrt(np.mean((tau - predict(now.q, now.v, now.a)) ** 2, axis=0))
    whole = 100 * float(np.linalg.norm(left)) / np.sqrt(np.mean(np.sum(tau**2, axis=1)))
    yield Row(key, " ".join(f"{x:.4g}" for x in left), f"{whole:.2f}", float(whole))


def parts(logs: Logs) -> tuple[str, str, float]:
    """How many values of two halves differ by more than their intervals, and of how many."""
    every = [*logs.runs, logs.held]
    cuts = [len(run.t) // 2 for run in every]
    halves = [[{name: x[rows] for name, x in table_of(run).items()} for run, rows in zip(every, some, strict=True)]
              for some in zip(*((slice(0, cut), slice(cut, None)) for cut in cuts), strict=True)]  # fmt: skip
    one, other = (tl.identify(logs.robot, half) for half in halves)
    same = [name for name in one.combinations if name in other.combinations]
    errors = [np.array([half.standard_errors[name] for name in same]) for half in (one, other)]
    moved = np.array([one.values[name] - other.values[name] for name in same])
    off = np.abs(moved) > 1.96 * np.hypot(*errors)
    return f"{off.sum()} of {len(same)}", f"{100 * off.mean():.3g}", float(off.mean())


def simulated() -> tuple[str, str, float]:
    """The residuals of a fit by simulation, rad, what it found, and the processor's seconds that it took."""
    logs, begin, knots = pendulum(), 3.0, np.linspace(0.0, 1.0, 100)
    run, names = logs.runs[0], logs.robot.joint_names
    now, tau = filtered(logs.robot, run, 8.0)
    half = (len(run.t) - len(tau)) // 2
    at = run.t[half : len(run.t) - half] - begin
    torques = {name: fx.Sampled(tuple(knots), tuple(np.interp(knots, at, x)))
               for name, x in zip(names, tau.T, strict=True)}  # fmt: skip
    effects = [fx.Gravity(), fx.Torque(torques), fx.JointDamping(dict.fromkeys(names, 0.01)),
               fx.SmoothFriction(dict.fromkeys(names, 0.05), scale=0.1)]  # fmt: skip
    q, v = ([np.interp(0.0, at, x) for x in columns.T] for columns in (now.q, now.v))
    seen = (run.t >= begin) & (run.t <= begin + 1.0)
    unknown = [f"{link}.{part}" for link in ("Link1", "Link2") for part in ("first_moment.z", "origin_inertia.xx")]
    seconds, found = once(lambda: tl.fit(
        tl.Scene(logs.robot, q, v, effects), {"t": run.t[seen] - begin, "q": run.q[seen]},
        [*unknown, "effects.2.damping.*", "effects.3.friction.*", "q", "v"]), time.process_time)  # fmt: skip
    text = f"{len(found.estimate)} found, {found.simulations} simulations, {seconds:.1f} s"
    return " ".join(f"{x:.4f}" for x in np.sqrt(np.mean(found.residuals**2, axis=0))), text, seconds


def show(rows: list[Row], given: argparse.Namespace) -> Bars:
    """The table, and whether the default is as good as the others, or the halves agree."""
    table, bars, best = Table("way <40 | rms, N m <60 | % <8"), [], Row("", "")
    for row in rows:
        table.add(row.way, row.left, row.percent)
        if given.fit:
            bars.append((row.size < SECONDS, row.percent))
        elif given.parts:
            bars.append((row.size <= SHARE, f"{row.way}: {row.percent} % beyond their intervals"))
        elif row.way.endswith("default"):
            best = row
        else:
            bars.append((best.size <= WORSE * row.size, f"default against {row.way}"))
    return bars


if __name__ == "__main__":
    own = {**dict.fromkeys(LOADED, ""), "twin": False, "parts": False, "fit": False}
    raise SystemExit(study(__doc__, "real-data", Row, rows_of, show, ways, scenes=0, **own))
