"""Held-out torques of a real double pendulum: the default of `tl.identify` beside fixed windows and published values.

    python -m scripts.studies.real_data [--windows 4,10,20,30,40]

Fitted on runs 00, 02 and 04 of tests/identification/double_pendulum, judged on run 12: root mean square
of the measured torques less their prediction, N m, all with the same states, filtered at 6 Hz. by hand: the
same base parameters by NumPy's least squares, filtered with 8 Hz. published: the parameters of its authors. Ends 0 if
the default is within 10 % of every other row. Rows go to out/real-data.csv.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import twolink as tl
from scripts.runner import TOP, Bars, Table, study
from twolink.identification.base_parameters import base_parameters, select
from twolink.identification.filtering import Recording, half_window_of, states

LOGS = TOP / "tests" / "identification" / "double_pendulum"
PUBLISHED = {"Link1.first_moment.z": -0.5594 * 0.3, "Link1.origin_inertia.xx": 0.05347, "Link2.mass": 0.6043,
             "Link2.first_moment.z": 0.6043 * 0.1838, "Link2.origin_inertia.xx": 0.02392,
             **{f"Joint{k}.armature": 36 * 7.66e-5 for k in (1, 2)}, **{f"Joint{k}.damping": 0.001 for k in (1, 2)},
             "Joint1.friction": 0.093, "Joint2.friction": 0.078}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """Residuals of one way, N m."""

    way: str
    shoulder: float
    elbow: float


def recording(number: str) -> Recording:
    with np.load(LOGS / f"run_{number}.npz") as log:
        return Recording(log["t"], log["q"].astype(float), None, None, log["tau"].astype(float))


def regression(robot: tl.Robot, run: Recording, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Y and tau with states filtered at a frequency, Hz."""
    half = half_window_of(cutoff, (len(run.t) - 1) / (run.t[-1] - run.t[0]))
    at = np.arange(half, len(run.t) - half)
    now = states(robot, run, half, "q", at)
    return robot.regressor(now.q, now.v, now.a), run.tau[at]


def parameters_by_hand(robot: tl.Robot, runs: list[Recording]) -> np.ndarray:
    chosen = select(robot, ["*"])
    members = list(base_parameters(robot, chosen).members)
    systems = [regression(robot, run, 8.0) for run in runs]
    columns = np.concatenate([(y @ chosen.columns)[..., members].reshape(-1, len(members)) for y, _ in systems])
    found = np.linalg.lstsq(columns, np.concatenate([tau.ravel() for _, tau in systems]), rcond=None)[0]
    return np.asarray(chosen.columns[:, members] @ found)


def ways(given: argparse.Namespace) -> list[str]:
    return ["default", *(f"window {half}" for half in given.windows), "by hand", "published"]


def rows_of(way: str, _given: argparse.Namespace) -> Iterator[Row]:
    """The residuals of a way."""
    robot = tl.load_robot(LOGS / "double_pendulum.urdf")
    runs = [recording(number) for number in ("00", "02", "04")]
    if way == "by hand":
        vector = parameters_by_hand(robot, runs)
    elif way == "published":
        vector = np.array([PUBLISHED.get(name, 0.0) for name in robot.parameter_names])
    else:
        half = None if way == "default" else int(way.split()[1])
        tables = [{"t": run.t, "q": run.q, "tau": run.tau} for run in runs]
        vector = tl.identify(robot, tables, parameters=["*"], half_window=half).consistency.vector
    matrix, tau = regression(robot, recording("12"), 6.0)
    yield Row(way, *np.sqrt(np.mean((tau - matrix @ vector) ** 2, axis=0)).tolist())


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The table, and whether the default is as good as the others."""
    table = Table("way <12 | shoulder >8.4f | elbow >8.4f")
    for row in rows:
        table.add(row.way, row.shoulder, row.elbow)
    best = rows[0]
    size = np.hypot(best.shoulder, best.elbow)
    return [(size <= 1.1 * np.hypot(row.shoulder, row.elbow), f"default against {row.way}") for row in rows[1:]]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "real-data", Row, rows_of, show, ways, scenes=0, windows=(4, 10, 20, 30, 40)))
