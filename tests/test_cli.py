"""The command line: what it prints, its exit codes (0 done, 1 failed, 2 misused), and errors in one line."""

import copy
import dataclasses
import io
import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP, answer, call, one_line
from twolink.cli.app import app, main

COMMANDS = ["robots", "inspect", "query", "check", "scenes", "explain", "run", "accuracy", "methods", "paper", "play",
            "hard-cases", "throw", "serve"]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches(command: str) -> None:
    done = call(command, "--help")
    assert done.returncode == 0
    assert f"Usage: twolink {command}" in done.stdout


def test_commands_are_all_there() -> None:
    assert sorted(c.name or c.callback.__name__ for c in app.registered_commands) == sorted(COMMANDS)


def test_robots_lists_all_with_sizes_or_reasons() -> None:
    rows = {row["name"]: row for row in answer("robots")}
    assert rows["two_link"]["nq"] == 2
    assert rows["two_link"]["mass"] == 4
    assert rows["talos"]["root"] == "free"
    assert rows["talos"]["nv"] == 38
    assert "no mass" in rows["romeo"]["refused"]


def test_inspect_reports() -> None:
    done = call("inspect", "panda", "--cross-check")
    assert done.returncode == 0
    for part in ("panda_joint1", "ignored:", "mimic", "assumed:", "second reading (yourdfpy): agree: 13 links"):
        assert part in done.stdout
    data = answer("inspect", "kinova")
    assert data["nq"] == 9
    assert data["report"]["assumed"]


@pytest.mark.parametrize("form", ["0.3 -0.7", "0.3,-0.7", "[0.3, -0.7]"])
def test_query_of_one_state(form: str) -> None:
    robot = tl.load_robot("two_link")
    found = answer("query", "two_link", "forward-dynamics", "--q", form, "--v", "1 2", "--tau", "3 4")
    assert np.array_equal(found["a"], robot.forward_dynamics([0.3, -0.7], [1, 2], [3, 4]))


def test_every_query_answers() -> None:
    robot = tl.load_robot("arm")
    q, v = [0.1, 0.2], [0.3, 0.4]
    expected = {"inverse-dynamics": {"tau": robot.inverse_dynamics(q, v, [0.0, 0.0])},
                "mass-matrix": {"M": robot.mass_matrix(q)},
                "bias": {"h": robot.bias(q, v)}, "coriolis": {"C": robot.coriolis(q, v)},
                "gravity-torque": {"g": robot.gravity_torque(q)}}  # fmt: skip
    for what, result in expected.items():
        speeds = () if what in ("mass-matrix", "gravity-torque") else ("--v", "0.3 0.4")
        found = answer("query", "arm", what, "--q", "0.1 0.2", *speeds)
        for name, value in result.items():
            assert np.array_equal(found[name], value)
    found = answer("query", "arm", "energy", "--q", "0.1 0.2", "--v", "0.3 0.4")
    assert (found["kinetic"], found["potential"]) == robot.energy(q, v)


def test_query_of_many_states_from_files_and_stdin(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    rng = np.random.default_rng(0)
    q, v, tau = rng.uniform(-1, 1, (3, 7, 2))
    expected = robot.forward_dynamics(q, v, tau)
    columns = {"q": q.tolist(), "v": v.tolist(), "tau": tau.tolist()}
    (tmp_path / "columns.json").write_text(json.dumps(columns))
    (tmp_path / "rows.json").write_text(json.dumps([{k: columns[k][i] for k in columns} for i in range(7)]))
    header = "q0,q1,v0,v1,tau0,tau1\n"
    table = header + "\n".join(",".join(map(repr, row)) for row in np.hstack([q, v, tau]).tolist())
    (tmp_path / "numbered.csv").write_text(table)
    named = table.replace(header, "q.shoulder,q.elbow,v.shoulder,v.elbow,tau.shoulder,tau.elbow\n")
    for name in ("columns.json", "rows.json", "numbered.csv"):
        assert np.array_equal(
            answer("query", "two_link", "forward-dynamics", "--states", str(tmp_path / name))["a"], expected
        )
    for text in (table, named, json.dumps(columns)):
        assert np.array_equal(
            answer("query", "two_link", "forward-dynamics", "--states", "-", stdin=text)["a"], expected
        )


def test_query_of_a_saved_trajectory(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.05)
    found = answer("query", "two_link", "energy", "--states", str(run.save(tmp_path / "run.csv")))
    np.testing.assert_allclose(np.add(found["kinetic"], found["potential"]), run.energy, rtol=0, atol=1e-12)


def test_query_with_a_wrench() -> None:
    robot = tl.load_robot("two_link")
    found = answer("query", "two_link", "inverse-dynamics", "--q", "0 0", "--f-ext", '{"tip": [0, 0, 1, 0, 0, 0]}')
    assert np.array_equal(found["tau"], robot.inverse_dynamics([0, 0], [0, 0], [0, 0], {"tip": [0, 0, 1, 0, 0, 0]}))


FAILED = {
    "robot": (["inspect", "pandda"], "did you mean 'panda'"),
    "states file": (["query", "arm", "bias", "--states", "none.csv"], "No such file"),
    "scene": (["run", "arm-swng"], "did you mean 'arm-swing'"),
    "play": (["play", "none.npz"], "No such file"),
}
BIAS = ["query", "arm", "bias", "--q", "0 0"]
MISUSED = {
    "command": (["inspct"], "Did you mean 'inspect'"),
    "no robot": (["inspect"], "robot"),
    "option": (["run", "arm-swing", "--accurac", "1"], "--accurac"),
    "words for a number": (["run", "arm-swing", "--accuracy", "high"], "--accuracy"),
    "root": (["inspect", "arm", "--root", "flying"], "root: 'flying' is unknown"),
    "n": (["check", "--n", "0"], "--n"),
    "query": (["query", "arm", "mass", "--q", "0 0"], "did you mean 'mass-matrix'"),
    "no q": (["query", "arm", "bias"], "q: it is not given"),
    "shape": (["query", "arm", "bias", "--q", "0 0 0"], "q: expected shape (..., 2), got (3,)"),
    "words": (["query", "arm", "bias", "--q", "a b"], "q: 'a b' is not a list of numbers"),
    "underscore": (["query", "arm", "bias", "--q", "1_0 0"], "q: '1_0 0' is not a list of numbers"),
    "deep": (["query", "arm", "bias", "--q", "[" * 100_000], "q: "),
    "tau for bias": ([*BIAS, "--tau", "1 1"], "bias takes no tau"),
    "q twice": ([*BIAS, "--states", "-"], "q: it is given twice"),
    "f_ext": (["query", "arm", "forward-dynamics", "--q", "0 0", "--f-ext", "{"], "not JSON"),
    "method": (["query", "arm", "forward-dynamics", "--q", "0 0", "--method", "crab"], "did you mean 'crba'"),
    "method of another": (["query", "arm", "mass-matrix", "--q", "0 0", "--method", "crba"], "takes no method"),
    "lock": ([*BIAS, "--lock", "elbow"], "lock: expected JOINT=VALUE, got 'elbow'"),
    "lock twice": ([*BIAS, "--lock", "elbow=0", "--lock", "elbow=1"], "lock: joint 'elbow' is given twice"),
    "locked joint": (["inspect", "arm", "--lock", "elbw=0"], "did you mean 'elbow'"),
    "gravity": (["inspect", "arm", "--gravity", "1 2"], "gravity: expected 3 finite numbers"),
    "unphysical": (["inspect", "arm", "--unphysical", "ignore"], "unphysical: 'ignore' is unknown"),
    "duration": (["run", "arm-swing", "--duration", "-1"], "above 0 s"),
    "accuracy": (["run", "arm-swing", "--accuracy", "0"], "accuracy: expected a number above 0"),
    "integrator": (["run", "arm-swing", "--method", "rk46"], "method: 'rk46' is unknown"),
    "samples": (["run", "arm-swing", "--samples", "nan"], "samples: expected a number above 0"),
    "speed": (["play", "none.npz", "--speed", "0"], "speed: expected a number above 0"),
}


@pytest.mark.parametrize("case", FAILED)
def test_failures_are_one_line_and_exit_1(case: str) -> None:
    arguments, part = FAILED[case]
    one_line(call(*arguments), 1, part)


@pytest.mark.parametrize("case", MISUSED)
def test_misuse_is_one_line_and_exit_2(
    case: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, part = MISUSED[case]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b'{"q": [0, 0]}')))
    monkeypatch.setattr(sys, "argv", ["twolink", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    one_line(subprocess.CompletedProcess(arguments, stop.value.code, *capsys.readouterr()), 2, part)


def test_bare_it_prints_the_help() -> None:
    done = call()
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: twolink")
    assert re.search(r"inspect +Say what a URDF holds", done.stdout)


def test_both_modules_are_the_command() -> None:
    old = subprocess.run([sys.executable, "-m", "twolink.cli", "--version"], capture_output=True, text=True, cwd=TOP)
    assert old.stdout == call("--version").stdout == f"twolink {tl.__version__}\n"


def test_options_say_which_robot() -> None:
    locked = tl.load_robot("two_link", lock={"elbow": -0.5}, gravity=(1, 2, 3))
    options = ("--lock", "elbow=-0.5", "--gravity", "1 2 3", "--unphysical", "report")
    assert answer("query", "two_link", "bias", "--q", "0.3", *options)["h"] == locked.bias([0.3], [0]).tolist()
    assert answer("inspect", "two_link", *options)["nq"] == 1
    assert answer("inspect", "panda", "--mimic")["nq"] == 8
    assert "gravity (1, 2, 3)" in call("inspect", "two_link", *options).stdout


def test_a_cross_check_judges(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    from twolink.robots import cross_check as second_reading

    robot = tl.load_robot("two_link")
    for name in ("two_link", "alex_psyonic_hands"):  # whose fingers mimic joints that do not move
        assert second_reading.compare(tl.load_robot(name))["agree"]
    text = robot.visuals.text
    for wrong in (text.replace('xyz="1 0 0"', 'xyz="1 0 1e-6"'), text.replace('mass value="', 'mass value="0.1')):
        assert wrong != text
        other = copy.copy(robot)
        other.visuals = dataclasses.replace(robot.visuals, text=wrong)
        found = second_reading.compare(other)
        assert not found["agree"]
        assert found["text"].startswith("DIFFER: ")
    monkeypatch.setattr(second_reading, "compare", lambda _: found)
    monkeypatch.setattr(sys, "argv", ["twolink", "inspect", "two_link", "--cross-check"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    out, err = capsys.readouterr()
    assert "second reading (yourdfpy): DIFFER" in out
    assert "read it differently" in err


def test_check_passes_and_says_what_is_misprinted() -> None:
    done = call("check", "--n", "200")
    assert done.returncode == 0
    assert "PASSED: the paper errs in C21, C22" in done.stdout


def test_a_failed_check_exits_1(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from twolink.lagrange import check

    failed = SimpleNamespace(passed=False, text=lambda: "FAILED", to_dict=dict)
    monkeypatch.setattr(check, "check", lambda **_: failed)
    monkeypatch.setattr(sys, "argv", ["twolink", "check"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    assert capsys.readouterr().out == "FAILED\n"
