"""States that come as text: what is read, what is refused and in which words."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import call
from twolink.cli.queries import read_states
from twolink.dynamics.queries import answer_query
from twolink.errors import QueryError
from twolink.io.text import parse_numbers


@pytest.fixture(scope="module")
def robot() -> tl.Robot:
    return tl.load_robot("two_link")


def ask(robot: tl.Robot, content: bytes, folder: Path) -> dict[str, np.ndarray]:
    (folder / "states").write_bytes(content)
    return answer_query(robot, "bias", read_states(robot, {}, folder / "states")[0])


REFUSED = {
    "nothing": (b"", "header"),
    "words": (b"hello", "header"),
    "array of numbers": (b"[1, 2]", "expected an object"),
    "uneven": (b'[{"q": [0, 0]}, {"v": [0, 0]}]', r"state 1 has \['v'\]"),
    "unknown key": (b'{"x": [0, 0]}', "takes no x"),
    "broken JSON": (b'{"q": [0,', "not JSON"),
    "deep JSON": (b'{"q": ' + b"[" * 100_000, "not .*JSON"),
    "deep closed JSON": (b'{"q": ' + b"[" * 200_000 + b"]" * 200_000 + b"}", "nested too deep"),
    "long integer": (b'{"q": [' + b"1" * 5000 + b", 0]}", "finite numbers, got inf"),
    "long float": (b'{"q": [' + b"1" * 400 + b", 0]}", "finite numbers, got inf"),
    "repeated key": (b'{"q": [0, 0], "q": [1, 1]}', "'q' is there twice"),
    "missing column": (b"q0,v0,v1\n1,2,3", "column 'q1' is missing"),
    "missing first column": (b"q1\n1", "column 'q0' is missing"),
    "unknown joint": (b"q0,q1,v.elbo\n1,2,3", "column 'v.elbo' is unknown"),
    "unknown entry": (b"q0,q1,q2\n1,2,3", "column 'q2' is unknown"),
    "no state": (b"x,y\n1,2", "no column is of a state: x, y"),
    "semicolons": (b"q0;q1\n0,1;0,2", "separated by ';'"),
    "words in a cell": (b"q0,q1\n1,two", "line 2: not a row of numbers"),
    "long row": (b"q0,q1\n1,2,3", "line 2: it has 3 cells"),
    "nan": (b"q0,q1\n1,nan", "finite numbers, got nan"),
    "long field": (b"q0,q1\n1," + b"1" * 200_000, "not CSV"),
    "not text": (b"\xff\xfe\x00", "not UTF-8"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_malformed_states_are_refused(case: str, robot: tl.Robot, tmp_path: Path) -> None:
    content, part = REFUSED[case]
    with pytest.raises(QueryError, match=part) as failure:
        ask(robot, content, tmp_path)
    assert "\n" not in str(failure.value)
    assert len(str(failure.value)) < 500


@pytest.mark.parametrize("content", [
    b"q0,q1,v0,v1\n\n1,2,3,4\n \n", b"\xef\xbb\xbfq0,q1,v0,v1\r\n1,2,3,4\r\n", b"v1,v0,q1,q0\n4,3,2,1\n",
    b'\xef\xbb\xbf[{"q": [1, 2], "v": [3, 4]}, {"v": [3, 4], "q": [1, 2]}]',
    b't,q.elbow,q.shoulder,v.shoulder,v.elbow\n0,2,1,3,4',
])  # fmt: skip
def test_blank_lines_byte_order_marks_and_order_do_not_matter(content: bytes, robot: tl.Robot, tmp_path: Path) -> None:
    assert (ask(robot, content, tmp_path)["h"] == robot.bias([[1, 2]], [[3, 4]])).all()


def test_stdin_that_is_not_text_is_refused(robot: tl.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\xff")))
    with pytest.raises(QueryError, match="not UTF-8"):
        read_states(robot, {}, Path("-"))


@pytest.mark.parametrize("text", ["1_0 0", "one", "1 2x", "\u0661 0"])
def test_malformed_numbers_are_refused(text: str) -> None:
    with pytest.raises(QueryError, match="is not a list of numbers"):
        parse_numbers("q", text)


def test_a_table_keeps_what_was_not_read_and_says_what_is_beyond_a_limit(tmp_path: Path) -> None:
    out = tmp_path / "torques.csv"
    done = call("query", "ur5", "inverse-dynamics", "--q", "0 -1 1 0 0 0", "--to", "1 -1 9 0 0 0", "--speed", "30",
                "--acceleration", "400", "--out", str(out))  # fmt: skip
    assert done.returncode == 0
    first = "note: joint 'elbow_joint' is beyond its limits of -3.14159 to 3.14159 rad"
    assert first in done.stderr
    assert "note: joint 'shoulder_pan_joint' needs " in done.stderr
    assert "beyond its limit of 150" in done.stderr
    header, *rows = out.read_text().splitlines()
    assert header.startswith("t,q.shoulder_pan_joint,")
    assert header.endswith(",tau.wrist_3_joint")
    again = call("query", "ur5", "inverse-dynamics", "--states", str(out), "--out", str(out))
    assert again.returncode == 0
    table = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    assert len(table) == len(rows)
    assert np.array_equal(table["given.tau.elbow_joint"], table["tau.elbow_joint"])


def test_columns_are_named_by_joints_where_they_are_of_joints(tmp_path: Path) -> None:
    """A velocity of a link has six numbers as an UR5 has joints."""
    out = tmp_path / "out.csv"
    given = "--q", "0 -1 1 0 0 0", "--v", "1 0 0 0 0 0"
    call("query", "ur5", "frame-velocity", *given, "--frame", "tool0", "--out", str(out))
    assert out.read_text().splitlines()[0].split(",")[12:] == [f"velocity.{k}" for k in range(6)]
    call("query", "ur5", "bias", *given, "--out", str(out))
    assert "h.elbow_joint" in out.read_text().splitlines()[0].split(",")


def test_limits_of_0_are_none() -> None:
    """Of URDFs that give <limit lower="0" upper="0" effort="0" velocity="0"/>."""
    done = call("query", "double_pendulum", "inverse-dynamics", "--q", "1 1", "--a", "3 3")
    assert (done.returncode, done.stderr) == (0, "")
    done = call("query", "double_pendulum", "inverse-dynamics", "--q", "0 0", "--to", "1 1", "--acceleration", "1")
    assert "--speed: the robot's file has none" in done.stderr


def test_columns_that_are_not_read_are_named(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("time,q0,q1,load\n0,0.1,0.2,5\n1,0.2,0.3,6\n")
    done = call("query", "two_link", "mass-matrix", "--states", str(path))
    assert "note: not read: time, load" in done.stderr
    out = tmp_path / "m.csv"
    assert call("query", "two_link", "mass-matrix", "--states", str(path), "--out", str(out)).stderr == ""
    assert out.read_text().splitlines()[0] == "time,load,q.shoulder,q.elbow,M.0.0,M.0.1,M.1.0,M.1.1"


def test_a_saved_run_answers_every_question(tmp_path: Path) -> None:
    """Its velocities and torques are passed over where they do not matter, and kept in the table of answers."""
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    path, out = run.save(tmp_path / "run.csv"), tmp_path / "m.csv"
    assert call("query", "two_link", "mass-matrix", "--states", str(path), "--out", str(out)).returncode == 0
    table = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    asked = np.array([[table[f"M.{i}.{k}"] for k in range(2)] for i in range(2)]).transpose(2, 0, 1)
    np.testing.assert_array_equal(asked, run.robot.mass_matrix(run.q))
    np.testing.assert_array_equal(table["v.elbow"], run.v[:, 1])
    np.testing.assert_array_equal(table["tau.elbow"], run.tau[:, 1])
    done = call("query", "two_link", "mass-matrix", "--q", "0 0", "--v", "1 1")
    assert "mass-matrix takes no v" in done.stderr


@pytest.mark.parametrize(("options", "words"), [
    (("--speed", "1"), "speed: it is of a motion"), (("--to", "1 1"), "acceleration: it is not given"),
    (("--to", "0 0", "--acceleration", "1"), "--to: it is where the motion begins"),
    (("--to", "1 1", "--v", "0 0", "--acceleration", "1"), "to: states are given already"),
    (("--out", "x.txt"), "'.txt' is not a format we know"),
])  # fmt: skip
def test_what_describes_no_motion_is_misuse(options: tuple[str, ...], words: str) -> None:
    done = call("query", "two_link", "energy", "--q", "0 0", *options)
    assert done.returncode in (1, 2)
    assert words in done.stderr
