"""Held-out torques of real robots: the default of `tl.identify` beside its options, other fits and published values.

    python -m scripts.studies.real_data [--logs FOLDER] [--twin] [--parts] [--seconds] [--fit]

The robots are those of `scripts.studies.real_logs`, which says where their logs are from. twin: simulated logs of a
Panda as `scripts.studies.intervals` has them; published is then the truth, but for offset, delay and drift.

Root mean square of the measured torques less their prediction by joint, N m, and of all in % of the torques', all
with the same states, filtered at 6 Hz (ur10e 10, tx40 30). The options: joint models for all joints, a robust fit, no
delay, cut-offs. by hand: base parameters and friction by NumPy's least squares, filtered with 8 Hz (tx40 30).
published: the parameters of the log's authors; of the Panda, those of its URDF. figaroh: its regressor and base
parameters, with friction, rotors and the same filter, where it is installed. mujoco: its sysid, where that is
installed (mujoco[sysid]), by inverse dynamics of 600 samples, same filter: bodies, rotors, friction, damping, offsets.

--parts: each log in disjoint halves, fitted alone: how many of the parameters that both tell differ by more than their
intervals, 1.96 standard deviations, add up to (root sum of squares); at most 10 %. Beside it, how many do by the noise
alone (`standard_errors`), of which the model's errors are no part. --seconds: the processor's seconds of the default
for 10,000 samples of the twin, at most 30. --fit: `tl.fit` on a second of run 00 of the pendulum, driven by a table of
100 torques for each joint, from the URDF's values: 12 unknowns, under 15 s of the processor. Otherwise ends 0 if the
default is within 5 % of every other row. Rows go to out/real-data.csv.
"""

import argparse
import contextlib
import functools
import io
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import twolink as tl
import twolink.effects as fx
from scripts.runner import Bars, Table, once, study
from scripts.studies.real_logs import ROBOTS, Logs
from twolink.parts.identification.base_parameters import base_parameters, select
from twolink.parts.identification.filtering import Recording, States, half_window_of, states

SHARE, SECONDS, WORSE = 0.10, 15.0, 1.05
SAMPLES, IDENTIFIED, SYSID = 10_000, 30.0, 600  # of 7 joints, in so many seconds; of the samples that sysid has
OPTIONS: dict[str, dict[str, Any]] = {
    "none": {"joint_model": "none"}, "viscous+coulomb": {"joint_model": "viscous+coulomb"},
    "with rotor": {"joint_model": "viscous+coulomb+rotor"},
    "with rotor, offset": {"joint_model": "viscous+coulomb+rotor+offset"},
    "with rotor, offset, stribeck": {"joint_model": "viscous+coulomb+rotor+offset+stribeck"},
    "robust": {"method": "robust"}, "no delay": {"find": ()}, "4 Hz": {"cutoff": 4.0}, "15 Hz": {"cutoff": 15.0},
}  # fmt: skip
Predict = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Row:
    """Residuals of one way by joint, N m, in % of the torques'; parts: how many values, and off."""

    way: str
    left: str
    percent: str = ""
    size: float = 0.0


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
    left = np.concatenate([np.concatenate(columns(*now)) for now, _ in systems])
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
    left = np.vstack([builder.build_basic_regressor(*now, drives) for now, _ in systems])
    used, by = np.flatnonzero(np.sum(left**2, axis=0) > 1e-6), QRDecomposer()
    tau = np.concatenate([tau.T.ravel() for _, tau in systems])  # joint by joint
    found = by.double_decomposition(tau, left[:, used], [str(k) for k in used])[3]
    base = used[by.base_indices]
    return lambda q, v, a: (builder.build_basic_regressor(q, v, a, drives)[:, base] @ found).reshape(n, -1).T


def _body(spec: Any, given: Any, name: str) -> None:
    """Mass, centre and the root of the second moments, which always stand for a body that can exist."""
    body, root = spec.body(name), np.zeros((3, 3))
    root[np.tril_indices(3)] = given.value[4:]
    moments = (np.sum(root**2) + 1e-9) * np.eye(3) - root @ root.T
    body.mass, body.ipos, body.iquat = given.value[0], given.value[1:4], [1, 0, 0, 0]
    body.fullinertia = moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _joint(spec: Any, given: Any, name: str, kind: str) -> None:
    setattr(spec.joint(name), kind, np.array([[*given.value], [0], [0]]) if kind == "damping" else given.value[0])


def mujoco(logs: Logs) -> Predict:
    """The torques of the model that MuJoCo's sysid finds, from the robot's own, by inverse dynamics.

    By simulation, as sysid has it, friction and noise take a motion off its log: in pieces of 0.5 s the pendulum keeps
    4 times as much, after 145 s of the processor. Its own parameters of bodies are for bodies with geoms.
    """
    import mujoco as mj
    from mujoco import sysid

    with tempfile.TemporaryDirectory() as folder:
        spec = mj.MjSpec.from_file(str(tl.export(logs.robot, Path(folder) / "robot.xml")))
    spec.option.disableflags |= mj.mjtDisableBit.mjDSBL_CONTACT.value | mj.mjtDisableBit.mjDSBL_LIMIT.value
    spec.compiler.balanceinertia = True  # of a URDF that no body has
    first, params, names = spec.compile(), sysid.ParameterDict(), logs.robot.joint_names
    for body in (body for body in map(first.body, range(1, first.nbody)) if body.dofnum[0]):
        x = np.array([max(body.mass[0], 0.1), *body.ipos, 0.1, 0, 0.1, 0, 0, 0.1])
        off, change = np.array([10 * x[0], *[0.5] * 3, *[2.0] * 6]), functools.partial(_body, name=body.name)
        params.add(sysid.Parameter(f"body {body.name}", x, np.append(0.01, (x - off)[1:]), x + off, modifier=change))
    for name in names:
        for kind in ("armature", "damping", "frictionloss"):
            change = functools.partial(_joint, name=name, kind=kind)
            params.add(sysid.Parameter(f"{kind} {name}", 0.5, 0.0, 100.0, modifier=change))
        params.add(sysid.Parameter(f"offset {name}", 0.0, -50.0, 50.0, modifier=lambda *_: None))

    def torques(params: Any, *now: np.ndarray) -> np.ndarray:
        model, out = sysid.apply_param_modifiers(params, spec), []
        data = mj.MjData(model)
        for data.qpos, data.qvel, data.qacc in zip(*now, strict=True):
            mj.mj_inverse(model, data)
            out.append(data.qfrc_inverse.copy())
        return np.array(out) + [params[f"offset {name}"].value[0] for name in names]

    systems = [filtered(logs.robot, run, logs.fitted) for run in logs.runs]
    step = max(1, sum(len(tau) for _, tau in systems) // SYSID)
    *now, tau = (np.concatenate(x)[::step] for x in zip(*((*state, tau) for state, tau in systems), strict=True))

    def residual(x: np.ndarray, params: Any, **_: Any) -> tuple[list[np.ndarray], None, None]:
        params.update_from_vector(x)
        return [((torques(params, *now) - tau) / tau.std(axis=0)).ravel()], None, None

    with contextlib.redirect_stdout(io.StringIO()):
        found = sysid.optimize(initial_params=params, residual_fn=residual, optimizer="scipy", verbose=False)[0]
    return lambda *now: torques(found, *now)


def installed(peer: str) -> bool:
    """MuJoCo's sysid is there, but empty, without its extras."""
    return find_spec(peer) is not None and (peer != "mujoco" or hasattr(import_module("mujoco.sysid"), "optimize"))


def ways(given: argparse.Namespace) -> list[str]:
    if given.fit or given.seconds:
        return ["pendulum, fit"] if given.fit else ["twin, seconds"]
    sets = [name for name in ROBOTS if name == "pendulum" or (given.twin if name == "twin" else given.logs)]
    each = ["parts"] if given.parts else ["default", *OPTIONS, "by hand", "published",
                                          *filter(installed, ("figaroh", "mujoco"))]  # fmt: skip
    return [f"{name}, {way}" for name in sets for way in each]


def rows_of(key: str, given: argparse.Namespace) -> Iterator[Row]:
    """The residuals of a way."""
    name, _, way = key.partition(", ")
    folder = Path(given.logs) / name
    if name in ("pendulum", "twin") or folder.is_dir():
        found = _row(ROBOTS[name](folder), way)
        if found:
            yield Row(key, *found)


def _row(logs: Logs, way: str) -> tuple[str, str, float] | None:
    if way in ("fit", "seconds", "parts"):
        return {"fit": simulated, "seconds": timed, "parts": parts}[way](logs)
    if (way == "published" and logs.published is None) or (way == "figaroh" and logs.robot.nv == 1):
        return None  # figaroh's regressor is for two joints and more
    predict: Predict
    if way in ("by hand", "figaroh", "mujoco"):
        predict = {"by hand": by_hand, "figaroh": figaroh, "mujoco": mujoco}[way](logs)
    elif way == "published":
        predict = lambda q, v, a: logs.robot.regressor(q, v, a) @ np.asarray(logs.published)  # noqa: E731
    else:
        predict = tl.identify(logs.robot, [*map(table_of, logs.runs)], **OPTIONS.get(way, {})).predict
    now, tau = filtered(logs.robot, logs.held, logs.judged)
    left = np.sqrt(np.mean((tau - predict(*now)) ** 2, axis=0))
    whole = 100 * float(np.linalg.norm(left)) / np.sqrt(np.mean(np.sum(tau**2, axis=1)))
    return " ".join(f"{x:.4g}" for x in left), f"{whole:.2f}", float(whole)


def timed(logs: Logs) -> tuple[str, str, float]:
    """The processor's seconds of the default for many samples."""
    run = logs.runs[0]
    at = np.linspace(run.t[0], run.t[-1], SAMPLES)
    columns = {name: np.column_stack([np.interp(at, run.t, x) for x in values.T])
               for name, values in (("q", run.q), ("tau", run.tau))}  # fmt: skip
    seconds, found = once(lambda: tl.identify(logs.robot, {"t": at, **columns}), time.process_time)
    return f"{len(found.estimate)} values of {SAMPLES} samples", f"{seconds:.1f} s", seconds


def parts(logs: Logs) -> tuple[str, str, float]:
    """How many values of two halves differ by more than their intervals, and of how many."""
    every = [*logs.runs, logs.held]
    cuts = [len(run.t) // 2 for run in every]
    halves = [[{name: x[rows] for name, x in table_of(run).items()} for run, rows in zip(every, some, strict=True)]
              for some in zip(*((slice(0, cut), slice(cut, None)) for cut in cuts), strict=True)]  # fmt: skip
    one, other = (tl.identify(logs.robot, half) for half in halves)
    same = [name for name in one.combinations if name in other.combinations]
    moved = np.array([one.values[name] - other.values[name] for name in same])
    noise = [1.96 * np.array([half.standard_errors[name] for name in same]) for half in (one, other)]
    width = [np.array([np.ptp(half.intervals[name]) / 2 for name in same]) for half in (one, other)]
    alone, off = (np.abs(moved) > np.hypot(*errors) for errors in (noise, width))
    return f"{off.sum()} of {len(same)}; by the noise alone {alone.sum()}", f"{100 * off.mean():.3g}", float(off.mean())


def simulated(logs: Logs) -> tuple[str, str, float]:
    """The residuals of a fit by simulation, rad, what it found, and the processor's seconds that it took."""
    begin, knots = 3.0, np.linspace(0.0, 1.0, 100)
    run, names = logs.runs[0], logs.robot.joint_names
    now, tau = filtered(logs.robot, run, 8.0)
    half = (len(run.t) - len(tau)) // 2
    at = run.t[half : len(run.t) - half] - begin
    torques = {name: fx.Sampled(tuple(knots), tuple(np.interp(knots, at, x)))
               for name, x in zip(names, tau.T, strict=True)}  # fmt: skip
    effects = [fx.Gravity(), fx.Torque(torques), fx.JointDamping(dict.fromkeys(names, 0.01)),
               fx.SmoothFriction(dict.fromkeys(names, 0.05), scale=0.1)]  # fmt: skip
    q, v = ([np.interp(0.0, at, x) for x in columns.T] for columns in now[:2])
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
        if given.fit or given.seconds:
            bars.append((row.size < (SECONDS if given.fit else IDENTIFIED), row.percent))
        elif given.parts:
            bars.append((row.size <= SHARE, f"{row.way}: {row.percent} % beyond their intervals"))
        elif row.way.endswith("default"):
            best = row
        else:
            bars.append((best.size <= WORSE * row.size, f"default against {row.way}"))
    return bars


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "real-data", Row, rows_of, show, ways, scenes=0, logs="", twin=False, parts=False,
                           seconds=False, fit=False))  # fmt: skip
