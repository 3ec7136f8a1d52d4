"""Slurm: blocks as array jobs by its command line, in shards that are worth a job, through a folder that nodes share.

A task, its result and its place in the queue are files named by its content. A caller that was killed finds what was
done meanwhile, and waits for what is still in the queue; nothing is computed twice.

Source: the manual pages of sbatch, squeue and scancel (slurm.schedmd.com).
"""

import contextlib
import hashlib
import json
import os
import pickle
import shlex
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import msgspec
import numpy as np

from twolink.errors import TwolinkError
from twolink.io.files import write_atomic
from twolink.io.fingerprints import code_key
from twolink.parts.sweeps.engines import BlockEngine
from twolink.parts.sweeps.runs import Columns, SweepTask, compute

SCHEME = "slurm:"
WORTH = 10.0  # s at least that a shard takes, as starting one takes a second or more
AT_ONCE = 500  # tasks given out; half of the array jobs that Slurm allows by default
GONE = 20.0  # s after which what has left the queue without a result has failed: folders of a network lag behind
LOOK = 1.0  # s between looks at folder and queue


class Slurm(BlockEngine):
    """The engine of `slurm:FOLDER?OPTION=VALUE&...`; options are sbatch's long ones, such as partition=cpu.

    Raises TwolinkError, code "batch-refused", where there is no Slurm.
    """

    width = AT_ONCE // 2

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self._folder = Path(parts.path).expanduser()
        self._options = [f"--{name}={value}" for name, value in parse_qsl(parts.query, keep_blank_values=True)]
        if not self._folder.is_absolute():
            raise _refused(f"{parts.path!r} is no absolute path", "give a folder that all nodes see: slurm:/scratch/me")
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        _run("sbatch", "--version")
        self._waiting: dict[str, tuple[SweepTask, Future[Columns]]] = {}
        self._sent: dict[str, tuple[str, Future[Columns]]] = {}  # with the number of the array job
        self._missing: dict[str, float] = {}  # since when
        self._taken: list[str] = []
        self._seconds = 0.0  # of a run; 0: nothing is known yet
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def submit(self, task: SweepTask) -> "Future[Columns]":
        """Give a task to the next shard, unless its result is there, or it is in the queue from an earlier call."""
        name, future = _name(task), Future[Columns]()
        future.set_running_or_notify_cancel()
        with self._lock:
            with contextlib.suppress(OSError):
                self._sent[name] = self._file(name, "job").read_text(), future
            if name not in self._sent:
                self._waiting[name] = task, future
        return future

    def _file(self, name: str, kind: str) -> Path:
        return self._folder / f"{name}.{kind}"

    def _watch(self) -> None:
        while not self._closing.wait(LOOK):
            with self._lock:
                try:
                    self._take()
                    self._send()
                except Exception as error:  # it is the failure of all that is under way
                    for _, future in (*self._waiting.values(), *self._sent.values()):
                        future.set_exception(error)
                    self._waiting.clear()
                    self._sent.clear()

    def _take(self) -> None:
        """Take results; what left the queue without one has failed, and is tried again as by any engine."""
        jobs = {job for job, _ in self._sent.values()}
        queued = {job for job in jobs if _is_queued(job)}
        for name, (job, future) in list(self._sent.items()):
            path = self._file(name, "result")
            if path.exists():
                seconds, runs, outcome = pickle.loads(path.read_bytes())
                self._seconds = max(self._seconds, seconds / runs) if runs else self._seconds
                (future.set_exception if isinstance(outcome, BaseException) else future.set_result)(outcome)
                self._taken.append(name)
            elif job not in queued and time.monotonic() - self._missing.setdefault(name, time.monotonic()) > GONE:
                future.set_exception(RuntimeError(f"array job {job} of Slurm ended without this result"))
                self._forget(name)
            else:
                continue
            del self._sent[name]
            self._missing.pop(name, None)

    def _send(self) -> None:
        """Send shards: first one task, which tells how long a run takes."""
        if not self._waiting or (not self._seconds and self._sent):
            return
        names = list(self._waiting)
        shards = self._shards(names) if self._seconds else [names[:1]]
        listed = self._folder / f"{hashlib.sha256(json.dumps(shards).encode()).hexdigest()[:20]}.shards"
        _write(listed, json.dumps(shards).encode())
        for name in (each for shard in shards for each in shard):
            _write(self._file(name, "task"), pickle.dumps(self._waiting[name][0]))
        program = f"import sys; from {__name__} import main; main(*sys.argv[1:])"
        command = shlex.join([sys.executable, "-c", program, str(self._folder), listed.name])
        job = _run("sbatch", "--parsable", "--job-name=twolink", f"--array=0-{len(shards) - 1}",
                   f"--output={self._folder}/slurm-%A_%a.log", *self._options, "--wrap", command)  # fmt: skip
        for name in (each for shard in shards for each in shard):
            self._sent[name] = job.partition(";")[0].strip(), self._waiting.pop(name)[1]
            _write(self._file(name, "job"), self._sent[name][0].encode())

    def _shards(self, names: list[str]) -> list[list[str]]:
        shards: list[list[str]] = [[]]
        seconds = 0.0
        for name in names:
            if seconds >= WORTH:
                shards.append([])
                seconds = 0.0
            shards[-1].append(name)
            seconds += self._seconds * self._waiting[name][0].runs
        if seconds < WORTH and len(shards) > 1:
            last = shards.pop()
            shards[-1] += last
        return shards

    def _forget(self, name: str) -> None:
        for kind in ("task", "result", "job"):
            self._file(name, kind).unlink(missing_ok=True)

    def close(self) -> None:
        """End what is in the queue, and delete the files of what was taken."""
        self._closing.set()
        self._thread.join()
        jobs = {job for job, future in self._sent.values() if not future.done()}
        if jobs:
            with contextlib.suppress(TwolinkError):
                _run("scancel", *sorted(jobs))
        for name in (*self._taken, *self._sent):
            self._forget(name)


def _name(task: SweepTask) -> str:
    """A digest of all that a task's result depends on."""
    values = {name: numbers.tolist() for name, numbers in task.values.items()}
    content = msgspec.json.encode([code_key(), task.key, task.request, values], enc_hook=np.generic.item)
    return hashlib.sha256(content).hexdigest()[:32]


def _write(path: Path, content: bytes) -> None:
    write_atomic(path, lambda file: file.write(content))


def _refused(what: str, remedy: str) -> TwolinkError:
    return TwolinkError(what, where="sweep", argument="executor", code="batch-refused", remedy=remedy)


def _run(*command: str) -> str:
    """The answer of a command of Slurm. Raises TwolinkError where it fails, or is not there."""
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout
    except FileNotFoundError:
        raise _refused(f"there is no {command[0]}", "call it on a node from which jobs are sent") from None
    except subprocess.CalledProcessError as error:
        what = " ".join(error.stderr.split())[:300]
        raise _refused(f"{command[0]} refuses: {what}", "check the options after the folder") from None


def _is_queued(job: str) -> bool:
    """True if a part of an array job waits or runs. Slurm forgets jobs that ended some minutes ago."""
    try:
        return bool(_run("squeue", "--noheader", f"--jobs={job}").strip())
    except TwolinkError:
        return False


def main(shared: str, listed: str) -> None:
    """Compute a shard of an array job; what has a result already is left out."""
    folder = Path(shared)
    for name in json.loads((folder / listed).read_text())[int(os.environ["SLURM_ARRAY_TASK_ID"])]:
        target = folder / f"{name}.result"
        if target.exists():
            continue
        task, begin = pickle.loads((folder / f"{name}.task").read_bytes()), time.monotonic()
        try:
            outcome: Columns | Exception = compute(task)
        except Exception as error:
            outcome = error
        _write(target, pickle.dumps((time.monotonic() - begin, task.runs, outcome)))
