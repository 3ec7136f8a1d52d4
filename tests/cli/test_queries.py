"""The commands robots, inspect, query and check."""

import copy
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call
from twolink.dynamics.queries import QUERIES
from twolink.robots import checks as second_reading


@pytest.mark.slow
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
    agree = "second reading (yourdfpy): agree: 13 links"
    for part in ("panda_joint1", "kg of its body", "ignored:", "mimic", "assumed:", agree):
        assert part in done.stdout
    data = answer("inspect", "kinova")
    assert data["nq"] == 9
    assert data["report"]["assumed"]


@pytest.mark.parametrize("form", ["0.3 -0.7", "0.3,-0.7", "[0.3, -0.7]"])
def test_query_of_one_state(form: str) -> None:
    robot = tl.load_robot("two_link")
    record = answer("query", "two_link", "forward-dynamics", "--q", form, "--v", "1 2", "--tau", "3 4")
    assert np.array_equal(record["a"], robot.forward_dynamics([0.3, -0.7], [1, 2], [3, 4]))


def test_states_by_joint_with_units() -> None:
    """As vectors, in every option; a motion begins and ends with what is not named where it is."""
    by_joint = ("--q", "elbow=-90deg, shoulder = 0.5", "--v", "elbow=180 deg/s")
    vectors = ("--q", f"0.5 {-np.pi / 2!r}", "--v", f"0 {np.pi!r}")
    assert answer("query", "two_link", "bias", *by_joint) == answer("query", "two_link", "bias", *vectors)
    turned = ("query", "two_link", "inverse-dynamics", "--q", "0 0", "--a")
    assert answer(*turned, "elbow=180 deg/s^2") == answer(*turned, f"0 {np.pi!r}")
    motion = ("query", "two_link", "inverse-dynamics", "--acceleration", "4", "--speed", "1")
    named = answer(*motion, "--q", "elbow=0.25", "--to", "shoulder=90deg")
    assert named == answer(*motion, "--q", "0 0.25", "--to", f"{np.pi / 2!r} 0.25")
    assert answer("query", "two_link", "energy", "--q", "0", "--lock", "elbow=-90deg")["potential"] == -4.905
    for wrong, part in (("elbow=9mm", "in rad, or as \"30 deg\""), ("elbw=1", "did you mean 'elbow'"),
                        ("elbow=1 elbow=2", "given twice"), ("elbow=", "expected 1 number, got 0")):  # fmt: skip
        done = call("query", "two_link", "energy", "--q", wrong)
        assert done.returncode == 2
        assert part in done.stderr
    assert answer("query", "two_link", "forward-dynamics", "--q", "0 0", "--tau", "elbow=1") == answer(
        "query", "two_link", "forward-dynamics", "--q", "0 0", "--tau", "0 1")  # fmt: skip


@pytest.mark.parametrize("what", [name for name in QUERIES if name != "inverse-kinematics"])
def test_every_query_answers(what: str) -> None:
    query = QUERIES[what]
    state = {"q": [0.1, 0.2], "v": [0.3, 0.4], "a": [0.5, -0.6], "tau": [0.7, 0.8]}
    given = {name: state[name] for name in query.arguments}
    options = {name: value for name, value in {"frame": "hand", "axes": "local"}.items() if name in query.options}
    words = [part for name, values in given.items() for part in (f"--{name}", "{} {}".format(*values))]
    words += [part for name, value in options.items() for part in (f"--{name}", value)]
    record = answer("query", "arm", what, *words)
    for name, value in query.answer(tl.load_robot("arm"), given, **options).items():
        assert np.array_equal(record[name], value), name


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
    ask = ("query", "two_link", "forward-dynamics", "--states")
    for name in ("columns.json", "rows.json", "numbered.csv"):
        assert np.array_equal(answer(*ask, str(tmp_path / name))["a"], expected)
    for text in (table, named, json.dumps(columns)):
        assert np.array_equal(answer(*ask, "-", stdin=text)["a"], expected)


def test_query_of_a_saved_trajectory(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.05)
    record = answer("query", "two_link", "energy", "--states", str(run.save(tmp_path / "run.csv")))
    np.testing.assert_allclose(np.add(record["kinetic"], record["potential"]), run.energy, rtol=0, atol=1e-12)


def test_a_robot_with_one_coordinate_has_one_column_a_letter() -> None:
    """A pendulum's table with the columns q and v."""
    table, robot = "t,q,v\n0,0.5,1\n1,-0.2,0\n2,1.5,-2\n", tl.load_robot("friction_pendulum")
    q, v = np.array([[0.5], [-0.2], [1.5]]), np.array([[1.0], [0.0], [-2.0]])
    record = answer("query", "friction_pendulum", "inverse-dynamics", "--states", "-", "--losses", stdin=table)
    assert np.array_equal(record["tau"], robot.inverse_dynamics(q, v, 0.0 * v, losses=True))


def test_query_with_a_wrench() -> None:
    robot = tl.load_robot("two_link")
    record = answer("query", "two_link", "inverse-dynamics", "--q", "0 0", "--f-ext", '{"tip": [0, 0, 1, 0, 0, 0]}')
    assert np.array_equal(record["tau"], robot.inverse_dynamics([0, 0], [0, 0], [0, 0], {"tip": [0, 0, 1, 0, 0, 0]}))


def test_options_say_which_robot() -> None:
    locked = tl.load_robot("two_link", lock={"elbow": -0.5}, gravity=(1, 2, 3))
    options = ("--lock", "elbow=-0.5", "--gravity", "1 2 3", "--unphysical", "report")
    assert answer("query", "two_link", "bias", "--q", "0.3", *options)["h"] == locked.bias([0.3], [0]).tolist()
    assert answer("inspect", "two_link", *options)["nq"] == 1
    assert answer("inspect", "panda", "--mimic")["nq"] == 8
    assert "gravity (1, 2, 3)" in call("inspect", "two_link", *options).stdout


def test_a_cross_check_that_finds_a_difference_exits_1(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = tl.load_robot("two_link")
    for name in ("two_link", "alex_psyonic_hands"):  # whose fingers mimic joints that do not move
        assert second_reading.compare(tl.load_robot(name))["agree"]
    text = robot.visuals.text
    for old, new in (('xyz="1.0 0.0 0.0"', 'xyz="1 0 1e-6"'), ('mass value="3.0"', 'mass value="0.13"')):
        assert old in text
        other = copy.copy(robot)
        other.visuals = dataclasses.replace(robot.visuals, text=text.replace(old, new))
        record = second_reading.compare(other)
        assert not record["agree"]
        assert record["text"].startswith("DIFFER: ")
    monkeypatch.setattr(second_reading, "compare", lambda _: record)
    done = call("inspect", "two_link", "--cross-check")
    assert done.returncode == 1
    assert "second reading (yourdfpy): DIFFER" in done.stdout
    assert "read it differently" in done.stderr


def test_check_passes_and_names_the_misprinted_entries() -> None:
    done = call("check", "--n", "20")
    assert done.returncode == 0
    assert "PASSED: the paper errs in C21, C22" in done.stdout
