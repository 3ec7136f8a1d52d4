"""The command line: what it prints, its exit codes (0 done, 1 failed, 2 misused), and errors in one line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.cli import app

TOP = Path(__file__).parents[1]
COMMANDS = ["robots", "inspect", "query", "check", "run", "paper", "play"]


def call(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "twolink.cli", *arguments]
    return subprocess.run(command, input=stdin, capture_output=True, text=True, cwd=TOP, timeout=120)


def answer(*arguments: str, stdin: str = "") -> dict:
    done = call(*arguments, "--json", stdin=stdin)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches(command: str) -> None:
    done = call(command, "--help")
    assert done.returncode == 0
    assert "Usage: twolink" in done.stdout.replace("python -m twolink.cli", "twolink").replace("cli.py", "twolink")


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
    for part in ("panda_joint1", "ignored:", "mimic", "assumed:", "second reading (yourdfpy): 13 links"):
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
    "query": (["query", "arm", "mass", "--q", "0 0"], "did you mean 'mass-matrix'"),
    "no q": (["query", "arm", "bias"], "q: it is not given"),
    "shape": (["query", "arm", "bias", "--q", "0 0 0"], "q: expected shape (..., 2), got (3,)"),
    "words": (["query", "arm", "bias", "--q", "a b"], "q: 'a b' is not a list of numbers"),
    "tau for bias": (["query", "arm", "bias", "--q", "0 0", "--tau", "1 1"], "bias takes no tau"),
    "f_ext": (["query", "arm", "forward-dynamics", "--q", "0 0", "--f-ext", "{"], "not JSON"),
    "method": (["query", "arm", "forward-dynamics", "--q", "0 0", "--method", "crab"], "did you mean 'crba'"),
    "states file": (["query", "arm", "bias", "--states", "none.csv"], "No such file"),
    "scene": (["run", "arm-swng"], "did you mean 'arm-swing'"),
    "duration": (["run", "arm-swing", "--duration", "-1"], "above 0 s"),
    "out": (["run", "arm-swing", "--duration", "0.1", "--out", "x.doc"], "not a format we know"),
    "play": (["play", "none.npz"], "No such file"),
}


@pytest.mark.parametrize("case", FAILED)
def test_failures_are_one_line_and_exit_1(case: str) -> None:
    arguments, part = FAILED[case]
    done = call(*arguments)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("twolink: ")
    assert part in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [["inspct"], ["inspect"], ["run", "arm-swing", "--accurac", "1"], ["run", "arm-swing", "--accuracy", "high"],
     ["inspect", "arm", "--root", "flying"], ["check", "--n", "0"]],
)  # fmt: skip
def test_misuse_is_one_line_and_exit_2(arguments: list[str]) -> None:
    done = call(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith("twolink: ")
    assert done.stderr.count("\n") == 1


STDIN = {
    "neither": ("hello", "header"),
    "array of numbers": ("[1, 2]", "expected an object"),
    "uneven": ('[{"q": [0, 0]}, {"v": [0, 0]}]', "state 1 has ['v']"),
    "unknown key": ('{"x": [0, 0]}', "takes no x"),
    "broken JSON": ('{"q": [0,', "not JSON"),
    "missing column": ("q0,v0,v1\n1,2,3", "column 'q1' is missing"),
    "unknown column": ("q0,q1,z\n1,2,3", "column 'z' is unknown"),
    "words": ("q0,q1\n1,two", "not a table of numbers"),
    "ragged": ("q0,q1\n1,2\n3", "not a table of numbers"),
    "nan": ("q0,q1\n1,nan", "finite numbers, got nan"),
}


@pytest.mark.parametrize("case", STDIN)
def test_states_that_are_none(case: str) -> None:
    text, part = STDIN[case]
    done = call("query", "two_link", "bias", "--states", "-", stdin=text)
    assert done.returncode == 1
    assert part in done.stderr
    assert done.stderr.count("\n") == 1


def test_check_passes_and_says_what_is_misprinted() -> None:
    done = call("check", "--n", "200")
    assert done.returncode == 0
    assert "PASSED: the paper errs in C21, C22" in done.stdout


def test_run_reports_and_writes(tmp_path: Path) -> None:
    names = ["x.csv", "x.npz", "x.png", "x.html"]
    outs = [part for name in names for part in ("--out", str(tmp_path / name))]
    done = answer("run", "arm-swing", "--duration", "0.5", "--accuracy", "1e-8", *outs)
    assert done["error"] <= 1e-8
    assert done["cost"]["evaluations"] > 0
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert "not verified" in call("run", "arm-swing", "--duration", "0.1", "--no-verify").stdout


def test_paper_answers_the_claims(tmp_path: Path) -> None:
    done = answer("paper", "--out", str(tmp_path))
    assert done["difference"] < 1e-8
    verdicts = {c["text"]: c["holds"] for c in done["claims"]}
    assert verdicts["theta1 stays below zero"]
    assert verdicts["theta2 changes sign when theta1 = -pi/2, twice a cycle"]
    assert not verdicts["the links' velocities oppose each other"]
    assert verdicts["the motion nearly repeats with m1 : m2 = 3 : 1"]
    assert not verdicts["the motion nearly repeats with m1 : m2 = 1 : 1"]
    assert not verdicts["the C matrix as printed gives this motion"]
    assert len(list(tmp_path.glob("*.png"))) == 2


def test_play_writes_a_page(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    saved = run.save(tmp_path / "run.npz")
    assert call("play", str(saved), "--html", str(tmp_path / "run.html")).returncode == 0
    assert (tmp_path / "run.html").stat().st_size > 500_000
    table = run.save(tmp_path / "run.csv")
    assert "does not name its robot" in call("play", str(table)).stderr
    assert call("play", str(table), "--robot", "two_link", "--html", str(tmp_path / "c.html")).returncode == 0
