"""Calling the command line: in this process, where it is imported already, or as a user does in one of its own."""

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

from twolink.cli.app import main

TOP = Path(__file__).parents[1]
TWOLINK = [sys.executable, "-m", "twolink"]


def call(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """What the command answers, without the second that a process takes to start."""
    given, out, err = (io.TextIOWrapper(io.BytesIO(text), "utf-8") for text in (stdin.encode(), b"", b""))
    with (
        patch.multiple(sys, argv=["twolink", *arguments], stdin=given, stdout=out, stderr=err),
        contextlib.chdir(TOP),
    ):
        try:
            main()
        except SystemExit as stop:
            code = stop.code
    texts = [(stream.flush(), stream.buffer.getvalue().decode())[1] for stream in (out, err)]
    return subprocess.CompletedProcess(arguments, code, *texts)


def call_process(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """The same in a process of its own."""
    return subprocess.run([*TWOLINK, *arguments], input=stdin, capture_output=True, text=True, cwd=TOP, timeout=300)


def printed_by(code: str, *arguments: str, **environment: str) -> str:
    """What Python code prints in a process of its own, which must end well."""
    command, variables = [sys.executable, "-c", code, *arguments], {**os.environ, **environment}
    done = subprocess.run(command, env=variables, capture_output=True, text=True, cwd=TOP, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


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
