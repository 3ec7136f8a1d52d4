"""The help of the command line: every command and every option that README and docs use is there."""

import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import twolink as tl
from tests.command import TOP, call, call_process
from twolink.cli.app import app
from twolink.cli.declared import DECLARED

COMMANDS = ["robots", "inspect", "query", "check", "scenes", "explain", "run", "accuracy", "methods", "paper", "play",
            "hard-cases", "throw", "serve", "identify", "excite", "fit", "new", "optimize", "sweep", "video",
            "linearize", "demo", "lint", "steps", "diff", "export", "judge", "compare", "mcp", *DECLARED]  # fmt: skip
TEXTS = "\n".join(path.read_text("utf-8") for path in [TOP / "README.md", *(TOP / "docs").rglob("*.md")])


def test_the_commands_are_these() -> None:
    listed = call("--help").stdout.partition("Commands:")[2]
    assert sorted(re.findall(r"^  ([a-z-]+) +[A-Z]", listed, re.MULTILINE)) == sorted(COMMANDS)
    assert len(app.registered_commands) + len(DECLARED) == len(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_the_options_that_texts_use(command: str) -> None:
    long, short = (CliRunner().invoke(app, [command, option], prog_name="twolink") for option in ("--help", "-h"))
    assert (long.exit_code, long.stderr) == (0, "")
    assert short.stdout == long.stdout
    assert f"Usage: twolink {command}" in long.stdout
    assert not re.search(r"<list\[|range>", long.stdout.partition("Options:")[2])
    for line in re.findall(rf"^twolink {command} ([^#\n]*)", TEXTS, re.MULTILINE):
        for option in re.findall(r"--[a-z-]+", line):
            assert f"{option} " in long.stdout, option


def test_summaries_of_the_commands_are_whole() -> None:
    done = call()
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == call("-h").stdout
    assert done.stdout.startswith("Usage: twolink")
    assert re.search(r"inspect +Say what a URDF holds", done.stdout)
    assert "..." not in done.stdout.partition("Commands:")[2]


def test_both_modules_are_the_command() -> None:
    old = subprocess.run([sys.executable, "-m", "twolink.cli", "--version"], capture_output=True, text=True, cwd=TOP)
    assert old.stdout == call_process("--version").stdout == f"twolink {tl.__version__}\n"
