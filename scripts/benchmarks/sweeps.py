"""Sweeps: runs a second with error bars beside mujoco.rollout, memory, Dask beside local processes, and the start.

    python -m scripts.benchmarks.sweeps [--only near] [--runs 100000] [--rounds 3] [--cells 1000000]

--only: some of start, near, far, dask.

near, far: the paper's arm, released at rest within 0.3 rad or 1 rad of the horizontal, 10 s at an accuracy of 1e-6,
verified, by as many local processes as there are cores (TWOLINK_THREADS). The time is that of the whole call: store,
processes and compiled steps that are loaded count. MuJoCo (RK4, as many threads) is timed on a few of the runs, at a
timestep at which nine of ten of its errors are as small as ours. Memory: the peaks of this process and of all workers
together; to compare numbers of runs, call it once for each. dask: a LocalCluster of one thread a worker, in turn with
local processes, both from workers that have begun. start: the time from the call for a grid of runs of 0.1 s until its
first block is written.
"""

import argparse
import itertools
import logging
import multiprocessing
import resource
import statistics
import tempfile
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import twolink as tl
from scripts.benchmarks.worlds import ACCURACY, FEW, beside_mujoco
from scripts.runner import Some, once, options, seconds_of
from twolink.dynamics.threads import thread_count

DURATION = 10.0
SHORT = 0.1  # s, of runs that take no time beside the start


def releases(count: int, reach: float) -> dict[str, np.ndarray]:
    """Releases of the arm, as the values of a list."""
    q = np.random.default_rng(0).uniform(-reach, reach, (count, 2))
    return {"q.shoulder": q[:, 0], "q.elbow": q[:, 1]}


def swept(out: Path, vary: dict[str, Any], **more: Any) -> tuple[float, Any]:
    """The seconds of a sweep of the arm, and its data."""
    how = {"duration": DURATION, "accuracy": ACCURACY, **more}
    return once(lambda: tl.sweep(tl.load_scene("arm-swing"), vary=vary, out=out, **how))


def start(folder: Path, given: argparse.Namespace) -> None:
    """Seconds until the first block of a grid is written."""
    side = round(given.cells**0.5)
    ranges = {name: {"range": [-1.0, 1.0, side]} for name in ("q.shoulder", "q.elbow")}

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    logging.disable()
    seconds, _ = swept(folder / "start.zarr", ranges, progress=stop, duration=SHORT)
    logging.disable(logging.NOTSET)
    print(f"start: the first block of {side**2:,} cells after {seconds:.1f} s", flush=True)


def speed(folder: Path, given: argparse.Namespace, reach: float) -> None:
    """Microseconds a run, memory, and MuJoCo's time at the same error."""
    vary = releases(given.runs, reach)
    done = [swept(folder / f"{reach}-{i}.zarr", vary, design="list") for i in range(given.rounds)]
    seconds, data = statistics.median(taken for taken, _ in done), done[-1][1]
    us = 1e6 * seconds / given.runs
    own, workers = (resource.getrusage(who).ru_maxrss / 1e6 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(f"within {reach:g} rad: {given.runs:,} runs in {seconds:.1f} s, {us:.1f} us a run, "
          f"{float((data.status == 1).mean()):.2%} within {ACCURACY:g}; {own:.2f} GB here and {workers:.2f} GB in each "
          "worker", flush=True)  # fmt: skip
    if find_spec("mujoco"):
        q = np.stack([numbers[:FEW] for numbers in vary.values()], axis=1)
        beside_mujoco(tl.load_scene("arm-swing"), q, np.zeros_like(q), DURATION, data.q.values[:FEW], us)


def engines(folder: Path, given: argparse.Namespace) -> None:
    """The time by Dask over that by local processes, in turn, on workers that have begun."""
    from distributed import Client, LocalCluster

    vary, numbers = releases(given.runs, 0.3), itertools.count()
    with (
        LocalCluster(n_workers=thread_count(), threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        ProcessPoolExecutor(thread_count(), multiprocessing.get_context("spawn")) as pool,
    ):
        calls = [lambda by=by: swept(folder / f"{next(numbers)}.zarr", vary, design="list", executor=by)
                 for by in (pool, client)]  # fmt: skip
        local, dask = seconds_of(*calls, rounds=given.rounds)
    print(f"{given.runs:,} runs: local {local:.2f} s, Dask {dask:.2f} s; ratio {dask / local:.3f}", flush=True)


PARTS = {
    "start": start,
    "near": lambda folder, given: speed(folder, given, 0.3),
    "far": lambda folder, given: speed(folder, given, 1.0),
    "dask": engines,
}


def main() -> None:
    given = options(__doc__, only=Some(PARTS), runs=100_000, rounds=3, cells=1_000_000)
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            PARTS[name](Path(folder), given)


if __name__ == "__main__":
    main()
