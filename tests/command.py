"""Calling the command line as a user does: in a process of its own."""

import json
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).parents[1]
TWOLINK = [sys.executable, "-m", "twolink"]


def call(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run([*TWOLINK, *arguments], input=stdin, capture_output=True, text=True, cwd=TOP, timeout=120)


def answer(*arguments: str, stdin: str = "") -> dict:
    done = call(*arguments, "--json", stdin=stdin)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def one_line(done: subprocess.CompletedProcess[str], code: int, part: str) -> None:
    assert done.returncode == code
    assert done.stdout == ""
    assert done.stderr.startswith("twolink: ")
    assert part in done.stderr
    assert done.stderr.count("\n") == 1
