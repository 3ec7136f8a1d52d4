"""Sweeps on Slurm, by stand-ins of its command line that run array jobs as processes of this machine."""

import json
import os
import stat
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import pendulum, wait_until
from tests.refusals import refusal
from twolink.errors import TwolinkError
from twolink.parts.sweeps import slurm

pytest.importorskip("zarr")
SBATCH = """#!{python}
import os, subprocess, sys, time
from pathlib import Path
log = Path({log!r})
if sys.argv[1:] == ["--version"]:
    sys.exit(print("slurm 23.11"))
if "--partition=none" in sys.argv:
    sys.exit("sbatch: error: invalid partition specified: none")
count = next(int(each.rpartition("-")[2]) + 1 for each in sys.argv if each.startswith("--array="))
job = str(len(list(log.glob("*.job"))) + 1)
(log / f"{{job}}.job").write_text("\\n".join(sys.argv[1:]))
for k in range(count):
    script = f"touch {{log}}/{{job}}.{{k}}.runs; {{sys.argv[-1]}} 2>>{{log}}/errors; rm {{log}}/{{job}}.{{k}}.runs"
    (log / f"{{job}}.{{k}}.runs").touch()
    subprocess.Popen(["sh", "-c", script], env={{**os.environ, "SLURM_ARRAY_TASK_ID": str(k)}}, start_new_session=True,
                     stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(job)
"""
SQUEUE = """#!/bin/sh
job=${{2#--jobs=}}
ls {log}/$job.*.runs 2>/dev/null
exit 0
"""


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the stand-ins write what they were asked for."""
    log, commands = tmp_path / "log", tmp_path / "bin"
    log.mkdir()
    commands.mkdir()
    scancel = "#!/bin/sh\necho $@ >> {log}/cancelled\n"
    for name, text in (("sbatch", SBATCH), ("squeue", SQUEUE), ("scancel", scancel)):
        path = commands / name
        path.write_text(text.format(python=sys.executable, log=str(log)))
        path.chmod(path.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setenv("PATH", f"{commands}:{os.environ['PATH']}")
    monkeypatch.setattr(slurm, "LOOK", 0.05)
    return log


def scene() -> tl.Scene:
    return tl.Scene(tl.load_robot(pendulum()), q=[0.4], effects=[tl.effects.Gravity()], duration=0.2)


def swept(out: Path, **options: object) -> object:
    vary = {"q.hinge": {"range": [0.1, 1.0, 8]}}
    return tl.sweep(scene(), out=out, **{"vary": vary, "chunk": 2, **options})


@pytest.mark.slow
def test_a_sweep_on_slurm_has_the_same_bits(tmp_path: Path, jobs: Path) -> None:
    folder = tmp_path / "shared"
    url = f"slurm:{folder}?partition=cpu&time=5"
    there = swept(tmp_path / "there.zarr", executor=url)
    here = swept(tmp_path / "here.zarr", executor=ThreadPoolExecutor(1))
    for name in ("q", "v", "error", "status"):
        assert np.array_equal(there[name], here[name]), name
    asked = [path.read_text().splitlines() for path in sorted(jobs.glob("*.job"))]
    assert all({"--parsable", "--partition=cpu", "--time=5"} <= set(each) for each in asked)
    assert ["--array=0-0" in each for each in asked] == [True, True]  # one to measure, and one for all: they are short
    assert not [path for path in folder.iterdir() if path.suffix in (".task", ".result", ".job")]


@pytest.mark.usefixtures("jobs")
def test_shards_take_ten_seconds(tmp_path: Path) -> None:
    engine = slurm.Slurm(f"slurm:{tmp_path}/shared")
    engine.close()
    engine._seconds = 0.5

    class Runs:
        runs = 4

    engine._waiting = {str(k): (Runs(), None) for k in range(23)}
    sizes = [len(shard) for shard in engine._shards(list(engine._waiting))]
    assert sizes == [5, 5, 5, 8]  # of 2 s each


def test_what_is_done_or_in_the_queue_is_not_sent_again(tmp_path: Path, jobs: Path) -> None:
    """A caller that was killed after it had sent its jobs."""
    url = f"slurm:{tmp_path}/shared"

    class Killed(BaseException):
        pass

    def kill(*_: object) -> None:
        wait_until(lambda: len(list((tmp_path / "shared").glob("*.job"))) == 4)  # all tasks have their place noted
        raise Killed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(slurm.Slurm, "close", lambda self: self._closing.set())
        with pytest.raises(Killed):
            swept(tmp_path / "runs.zarr", executor=url, progress=kill)
    sent = len(list(jobs.glob("*.job")))
    assert sent == 2  # the first one told how long a run takes
    data = swept(tmp_path / "runs.zarr", executor=url)
    assert (data["status"] == 1).all()
    assert len(list(jobs.glob("*.job"))) == sent


@pytest.mark.usefixtures("jobs")
def test_what_slurm_refuses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "runs.zarr"
    with refusal(TwolinkError, code="batch-refused", match="invalid partition"):
        swept(out, executor=f"slurm:{tmp_path}/shared?partition=none")
    with pytest.raises(TwolinkError, match="absolute"):
        swept(out, executor="slurm:shared")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(TwolinkError, match="there is no sbatch"):
        swept(out, executor=f"slurm:{tmp_path}/shared")


def test_a_job_that_ends_without_a_result_is_tried_again_and_given_up(
    tmp_path: Path, jobs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slurm, "GONE", 0.3)
    monkeypatch.setattr(slurm.sys, "executable", "/bin/false")
    data = swept(tmp_path / "runs.zarr", vary={"q.hinge": [0.1]}, executor=f"slurm:{tmp_path}/shared")
    assert data["status"].values.tolist() == [4]
    assert len(list(jobs.glob("*.job"))) == 3
    assert "without this result" in str(data["reason"].values[0])
    assert json.loads((next((tmp_path / "shared").glob("*.shards"))).read_text())
