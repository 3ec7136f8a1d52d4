"""`twolink check --module`: a student's file beside a robot; exit codes 0 right, 1 wrong, 2 bad input."""

import json
from pathlib import Path

import pytest

import twolink as tl
from tests.command import call, call_process, one_line

RIGHT = """
import numpy as np

print("imported")
arm = (1.0, 1.0), (3.0, 1.0)


def M(q):
    coupling, own = np.cos(q[1]) / 2, 1 / 3
    return [[2 + own + 2 * coupling, own + coupling], [own + coupling, own]]


def h(q, v):
    bent, forearm = np.sin(q[1]) / 2, 9.81 / 2 * np.cos(q[0] + q[1])
    return [-bent * (2 * v[0] * v[1] + v[1] ** 2) + 2.5 * 9.81 * np.cos(q[0]) + forearm, bent * v[0] ** 2 + forearm]
"""
WRONG = RIGHT.replace("bent * v[0] ** 2 + forearm]", "bent * v[0] ** 2 - forearm]")


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(RIGHT)
    return path


def test_right_equations_exit_0(mine: Path) -> None:
    for more in ((), ("--robot", "two_link", "--to", "own"), ("--to", "[[1, 0], [0, 1]]")):
        done = call("check", "--module", str(mine), *more)
        assert done.returncode == 0, done.stderr
        assert "the equations are right" in done.stdout
        assert "imported" not in done.stdout  # what the file prints


def test_wrong_equations_exit_1_and_the_command_says_what_python_says(mine: Path) -> None:
    mine.write_text(WRONG)
    done = call_process("check", "--module", str(mine), "--json")
    assert done.returncode == 1
    names: dict = {}
    exec(WRONG, names)
    report = tl.check_equations(names["M"], names["h"], "two_link")
    assert json.loads(done.stdout) == json.loads(json.dumps(report.to_dict()))
    assert report.wrong[0].mend == "the gravity term has the wrong sign"
    done = call("check", "--module", str(mine))
    assert (done.returncode, done.stdout) == (1, f"{report}\n")


def test_options_of_robots_hold_for_it(mine: Path) -> None:
    mine.write_text("def M(q):\n return [[7 / 3]]\ndef h(q, v):\n return [0.0]\n")
    assert call("check", "--module", str(mine), "--robot", "two_link", "--lock", "elbow=1.5707963267948966",
                "--gravity", "0 0 0").returncode == 0  # fmt: skip


BAD = {
    "no file": ("", ("--module", "none.py"), "none.py: cannot be read: No such file"),
    "no python": ("M = (", (), "it raised SyntaxError"),
    "raises": ("1 / 0", (), "mine.py: it raised ZeroDivisionError: division by zero (mine.py, line 1)"),
    "exits": ("import sys\nsys.exit(0)", (), "it raised SystemExit: 0 (mine.py, line 2)"),
    "no h": ("def M(q): ...", (), "mine.py: it defines no h; define M(q)"),
    "shape": (RIGHT, ("--robot", "ur5"), "mine.py: M: expected shape (6, 6), got (2, 2)"),
    "robot": (RIGHT, ("--robot", "two_lnk"), "did you mean 'two_link'"),
    "to": (RIGHT, ("--to", "absolut"), "--to: 'absolut' is unknown"),
    "matrix": (RIGHT, ("--to", "[[1]"), "--to: not JSON"),
    "seed": (RIGHT, ("--seed", "3"), "leave them out"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_exits_2_with_its_place(case: str, mine: Path) -> None:
    text, options, part = BAD[case]
    mine.write_text(text)
    done = call("check", *(("--module", str(mine)) if "--module" not in options else ()), *options)
    assert done.returncode == 2
    assert done.stdout == ""
    assert part in done.stderr.removeprefix("imported\n")
    assert done.stderr.removeprefix("imported\n").count("\n") == 1


@pytest.mark.parametrize("option", [("--robot", "arm"), ("--to", "absolute"), ("--lock", "elbow=0")])
def test_options_of_own_equations_want_the_file(option: tuple[str, str]) -> None:
    one_line(call("check", *option), 2, f"{option[0]}: it is of your own equations; give --module")
