"""A Dask cluster in a process of its own."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

TOP = Path(__file__).parents[3]
SCRIPT = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(threads_per_worker=1, dashboard_address=None, {options})
    print(cluster.scheduler_address, flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def dask_cluster(folder: Path, options: str, **variables: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A cluster and its address. Its script is in the folder, and it is killed at the end."""
    script = folder / "cluster.py"
    script.write_text(SCRIPT.format(options=options))
    environment = {**os.environ, "PYTHONPATH": str(TOP), **variables}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    command = [sys.executable, str(script)]
    with subprocess.Popen(command, cwd=TOP, env=environment, start_new_session=True, **pipes) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            os.killpg(process.pid, signal.SIGKILL)
