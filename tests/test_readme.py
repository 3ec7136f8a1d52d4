"""The README's commands and code are run."""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.parts.service.serving import serving

TOP = Path(__file__).parents[1]
TEXT = (TOP / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)
COMMANDS = re.findall(r"^twolink .*$", "\n".join(block for kind, block in BLOCKS if kind == "sh"), re.MULTILINE)
ADDRESS = "http://127.0.0.1:8000"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(TOP)}


@pytest.mark.parametrize(("name", "size"), [("README.md", 8192), ("CHANGELOG.md", 4096)])
def test_it_is_short(name: str, size: int) -> None:
    assert (TOP / name).stat().st_size <= size, f"{name}: what does not fit belongs in docs/"


def test_there_is_something_to_run() -> None:
    assert len(COMMANDS) >= 8
    assert sum(kind == "python" for kind, _ in BLOCKS) >= 1


@pytest.mark.slow
def test_commands(tmp_path: Path) -> None:
    """In order, since later ones read what earlier ones wrote; in a folder with the robots of a checkout."""
    (tmp_path / "urdf").symlink_to(TOP / "urdf")
    for line in COMMANDS:
        arguments = shlex.split(line, comments=True)[1:]
        arguments += ["--html", "demo.html"] * (arguments == ["demo"])  # it would wait in the browser
        done = subprocess.run(
            [sys.executable, "-m", "twolink.cli", *arguments],
            cwd=tmp_path, capture_output=True, text=True, timeout=120, env=ENVIRONMENT,
        )  # fmt: skip
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        assert done.stdout, line


@pytest.mark.parametrize("code", [block for kind, block in BLOCKS if kind == "python"])
def test_code(code: str, tmp_path: Path) -> None:
    with contextlib.ExitStack() as stack:
        if ADDRESS in code:
            service = stack.enter_context(serving(tmp_path / "data"))
            code = code.replace(ADDRESS, service.url)
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code],
            cwd=tmp_path, capture_output=True, text=True, timeout=120, env=ENVIRONMENT,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = {p.name for p in (tmp_path / "out").iterdir()} if (tmp_path / "out").exists() else set()
    assert written == set(re.findall(r"out/([\w.]+)", code))


def test_scripts_and_pictures_exist() -> None:
    for name in re.findall(r"scripts/(?:demo|test)\b", TEXT):
        assert shutil.which(str(TOP / name)), name
    for name in re.findall(r"\]\((?!http)(.*?)\)", TEXT):
        assert (TOP / name).is_file(), name
