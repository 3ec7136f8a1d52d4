"""scripts/nightly: every step runs, a failing one makes it fail, and each has a log."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
NIGHTLY = TOP / "scripts" / "nightly"
STEPS = [
    "slow-tests",
    "hard-cases",
    "error-bars",
    "sensitivities",
    "stops",
    "contact-steps",
    "loops",
    "referee",
    "catalogue",
    "price",
    "core",
    "coverage",
    "sanitizers",
    "processors",
    "pythons",
]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with the script and a Python that says its arguments, and fails where they hold the word in `fails`."""
    (tmp_path / "scripts").mkdir()
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    shutil.copy(NIGHTLY, tmp_path / "scripts")
    (tmp_path / "scripts" / "setup.sh").write_text("")
    python = tmp_path / ".venv" / "bin" / "python"
    python.write_text('#!/bin/sh\necho "$@"\ncase "$*" in *"$(cat fails)"*) exit "$(cat code)" ;; esac\n')
    python.chmod(0o755)
    (tmp_path / "fails").write_text("nothing fails")
    (tmp_path / "code").write_text("1")
    return tmp_path


def nightly(checkout: Path, *steps: str) -> tuple[int, str, dict[str, str]]:
    """The exit code, the summary, and the logs by step."""
    command = [str(checkout / "scripts" / "nightly"), *steps]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env={"PATH": os.environ["PATH"]})
    logs = {path.stem: path.read_text() for path in checkout.glob("out/nightly/*/*.*")}
    return done.returncode, logs.pop("summary", done.stderr), logs


def test_all_steps_run_with_a_log_each(checkout: Path) -> None:
    code, summary, logs = nightly(checkout)
    assert code == 0
    assert [line.split()[0] for line in summary.splitlines()[1:]] == STEPS
    assert summary.count("passed") == len(STEPS)
    assert logs.keys() == set(STEPS)
    assert "-m slow" in logs["slow-tests"]
    assert "--scenes 1000" in logs["error-bars"]


def test_a_step_that_fails_makes_it_fail_and_the_others_run(checkout: Path) -> None:
    (checkout / "fails").write_text("hard-cases")
    code, summary, logs = nightly(checkout)
    assert code == 1
    assert re.search(r"hard-cases +\d+ s  failed with exit code 1\n", summary)
    assert summary.count("passed") == len(STEPS) - 1
    assert logs.keys() == set(STEPS)


def test_an_interrupted_step_ends_it(checkout: Path) -> None:
    (checkout / "fails").write_text("hard-cases")
    (checkout / "code").write_text("130")
    code, summary, logs = nightly(checkout)
    assert code == 130
    assert "interrupted" in summary
    assert logs.keys() == {"slow-tests", "hard-cases"}


def test_steps_can_be_chosen_by_name(checkout: Path) -> None:
    code, _, logs = nightly(checkout, "stops")
    assert code == 0
    assert logs.keys() == {"stops"}


def test_an_unknown_step_is_refused_before_anything_runs(checkout: Path) -> None:
    code, message, logs = nightly(checkout, "stops", "stps")
    assert (code, message) == (2, f"unknown step stps; known: {' '.join(STEPS)}\n")
    assert not logs


def test_the_files_that_it_names_exist() -> None:
    named = re.findall(r"scripts/\w+\.sh|tests/[\w/]+\.py", NIGHTLY.read_text())
    named += [f"{name.replace('.', '/')}.py" for name in re.findall(r"-m (scripts[\w.]+)", NIGHTLY.read_text())]
    assert len(named) >= 8
    assert all((TOP / name).exists() for name in named)
