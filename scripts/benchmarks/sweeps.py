"""Sweeps: runs a second with error bars beside mujoco.rollout, memory, Dask beside local processes, and the start.

    python scripts/bench_sweep.py [--only near] [--runs 100000] [--rounds 3] [--cells 1000000] [--json FILE]

--only, repeatable, is one of start, near, far, dask; without it all of them are measured.

near, far: the paper's arm, released at rest within 0.3 rad or 1 rad of the horizontal, 10 s at an accuracy of 1e-6,
verified, by as many local processes as there are cores (TWOLINK_THREADS). The time is that of the whole call: store,
processes and compiled steps that are loaded count. MuJoCo (RK4, as many threads) is timed on a few of the runs, at a
timestep at which nine of ten of its errors are as small as ours. Memory: the peaks of this process and of all workers
together; to compare numbers of runs, call it once for each. dask: a LocalCluster of one thread a worker, in turn with
local processes, both from workers that have begun. start: the time from the call for a grid of runs of 0.1 s until its
first block is written.
"""

import argparse
import json
import logging
import multiprocessing
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from bench_worlds import ACCURACY, FEW, beside_mujoco

import twolink as tl
from twolink.dynamics.threads import thread_count

DURATION = 10.0
SHORT = 0.1  # s, of runs that take no time beside the start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=PARTS)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cells", type=int, default=1_000_000)
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = {name: PARTS[name](Path(folder), options) for name in options.only or PARTS}
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))


def releases(count: int, reach: float) -> dict[str, np.ndarray]:
    """Releases of the arm, as the values of a list."""
    q = np.random.default_rng(0).uniform(-reach, reach, (count, 2))
    return {"q.shoulder": q[:, 0], "q.elbow": q[:, 1]}


def swept(out: Path, vary: dict[str, Any], **options: Any) -> tuple[Any, float]:
    """A sweep of the arm, and its seconds."""
    begin = time.perf_counter()
    data = tl.sweep(tl.load_scene("arm-swing"), vary, out, accuracy=ACCURACY, **{"duration": DURATION, **options})
    return data, time.perf_counter() - begin


def start(folder: Path, options: argparse.Namespace) -> float:
    """Seconds until the first block of a grid is written."""
    side = round(options.cells**0.5)
    ranges = {name: {"range": [-1.0, 1.0, side]} for name in ("q.shoulder", "q.elbow")}

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    logging.disable()
    seconds = swept(folder / "start.zarr", ranges, progress=stop, duration=SHORT)[1]
    logging.disable(logging.NOTSET)
    print(f"start: the first block of {side**2:,} cells after {seconds:.1f} s", flush=True)
    return seconds


def speed(folder: Path, options: argparse.Namespace, reach: float) -> dict[str, float]:
    """Microseconds a run, memory, and MuJoCo's time at the same error."""
    vary, seconds = releases(options.runs, reach), []
    for i in range(options.rounds):
        data, took = swept(folder / f"{reach}-{i}.zarr", vary, design="list")
        seconds.append(took)
    us = 1e6 * statistics.median(seconds) / options.runs
    own, workers = (resource.getrusage(who).ru_maxrss / 1e6 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    row = {"us": us, "seconds": statistics.median(seconds), "done": float((data.status == 1).mean()),
           "memory_gb": own + thread_count() * workers}  # fmt: skip
    print(f"within {reach:g} rad: {options.runs:,} runs in {row['seconds']:.1f} s, {us:.1f} us a run, "
          f"{row['done']:.2%} within {ACCURACY:g}; {own:.2f} GB here and {workers:.2f} GB in each worker",
          flush=True)  # fmt: skip
    if find_spec("mujoco"):
        q = np.stack([numbers[:FEW] for numbers in vary.values()], axis=1)
        scene = tl.load_scene("arm-swing")
        row |= beside_mujoco(scene, q, np.zeros_like(q), DURATION, data.q.values[:FEW], us)
    return row


def engines(folder: Path, options: argparse.Namespace) -> float:
    """The time by Dask over that by local processes, in turn, on workers that have begun."""
    from distributed import Client, LocalCluster

    vary = releases(options.runs, 0.3)
    with (
        LocalCluster(n_workers=thread_count(), threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        ProcessPoolExecutor(thread_count(), multiprocessing.get_context("spawn")) as pool,
    ):
        ways: dict[str, Any] = {"local": pool, "Dask": client}
        seconds: dict[str, list[float]] = {name: [] for name in ways}
        for i in range(options.rounds + 1):
            for name, executor in ways.items():
                took = swept(folder / f"{name}{i}.zarr", vary, design="list", executor=executor)[1]
                seconds[name] += [took] if i else []
    ratio = statistics.median(seconds["Dask"]) / statistics.median(seconds["local"])
    shown = ", ".join(f"{name} {statistics.median(times):.2f} s" for name, times in seconds.items())
    print(f"{options.runs:,} runs: {shown}; ratio {ratio:.3f}", flush=True)
    return ratio


PARTS: dict[str, Callable[[Path, argparse.Namespace], Any]] = {
    "start": start,
    "near": lambda folder, options: speed(folder, options, 0.3),
    "far": lambda folder, options: speed(folder, options, 1.0),
    "dask": engines,
}

if __name__ == "__main__":
    main()
