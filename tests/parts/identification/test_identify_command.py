"""The command identify: files of measurements, a table or JSON, and a URDF."""

import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call, one_line
from tests.parts.identification.motions import columns, motion, noisy
from tests.refusals import refusal
from tests.simulation.test_sensitivities import FREE
from twolink.errors import QueryError
from twolink.identification import read_log
from twolink.io.tables import write_table

ARM = tl.load_robot("arm")
T, Q, V, A = motion(ARM, 200)
TAU = noisy(ARM.inverse_dynamics(Q, V, A), 0.02)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_table(
        tmp_path / "log.csv", {"t": T, "q.shoulder": Q[:, 0], "q.elbow": Q[:, 1], **columns(tau=TAU)}, {}
    )


def test_values_intervals_and_what_cannot_be_told(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.urdf"
    names = "forearm.mass, forearm.first_moment.*"
    record = answer("identify", "arm", str(log), "--parameters", names, "--out", str(out))
    mass = record["found"][0]
    assert mass["parameter"] == "forearm.mass"
    assert mass["low"] < ARM.parameter_values[10] < mass["high"]
    assert record["not_identifiable"] == ["forearm.first_moment.y: no torque depends on it"]
    assert record["consistency"]["consistent"]
    assert tl.load_robot(out).mass == pytest.approx(ARM.mass, abs=0.05)


def test_the_table_is_for_people(log: Path) -> None:
    done = call("identify", "arm", str(log))
    assert done.returncode == 0
    assert "95 % intervals" in done.stdout
    assert "cannot be identified: only the sum upper_arm.first_moment.z - 0.2817 forearm.mass" in done.stdout


def test_misuse_and_bad_files(log: Path, tmp_path: Path) -> None:
    one_line(call("identify", "arm", str(log), "--parameters", "forarm.mass"), 2, "did you mean 'forearm.mass'")
    one_line(call("identify", "arm", str(log), "--method", "best"), 2, "method: 'best' is unknown")
    one_line(call("identify", "arm", str(log), "--out", str(tmp_path / "a.txt")), 2, "is not a format we know")
    one_line(call("identify", "arm", str(tmp_path / "none.csv")), 1, "No such file")


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".npz"])
def test_files_of_every_kind_are_read(tmp_path: Path, ending: str) -> None:
    arrays = {"q": Q, "v": V, "a": A, "tau": TAU}
    read = read_log(ARM, write_table(tmp_path / f"log{ending}", {"t": T, **columns(**arrays)}, {})).table
    for name, wanted in (arrays | {"t": T}).items():
        assert np.array_equal(read[name], wanted)


def test_whole_arrays_are_read_and_missing_columns_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU)
    read = read_log(ARM, tmp_path / "log.npz").table
    assert "v" not in read
    assert np.array_equal(read["tau"], TAU)
    for lacking in ("t", "q1", "tau0"):
        there = {name: x for name, x in {"t": T, **columns(q=Q, tau=TAU)}.items() if name != lacking}
        path = write_table(tmp_path / "log.csv", there, {})
        with refusal(QueryError, code="column-missing", match="is missing; there are"):
            read_log(ARM, path)


MAP = """
t = "stamp"
q.shoulder = "enc0"
q.elbow = { column = "enc1", scale = -1.0 }
tau.shoulder = { column = "i0", scale = 2.5 }
tau.elbow = { column = "i1", scale = 2.5 }
"""


def foreign(path: Path, rows: slice, spike: int) -> Path:
    """A log in milliseconds and degrees, of currents, with an outlier."""
    q = np.degrees(Q) * [1, -1]
    q[spike, 0] += 90.0
    table = {"stamp": 1e3 * T, **columns(enc=q, i=TAU / 2.5)}
    return write_table(path, {name: x[rows] for name, x in table.items()}, {})


def test_from_the_logs_of_a_robot_to_a_report(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP)
    files = [foreign(tmp_path / f"{k}.csv", slice(50 * k, 50 * k + 50), 50 * k + 25) for k in range(4)]
    page = tmp_path / "report.html"
    record = answer("identify", "arm", *map(str, files[:3]), "--parameters", "forearm.*", "--columns",
                    str(tmp_path / "map.toml"), "--units", "deg,ms", "--validate", str(files[3]), "--html", str(page),
                    "--joint-model", "viscous")  # fmt: skip
    found = {row["parameter"]: row for row in record["found"]}
    row = found["forearm.first_moment.z"]
    assert row["low"] < ARM.parameter_values[13] < row["high"]
    assert {"shoulder.damping", "elbow.damping"} <= set(found)
    assert sum("1 outliers of q0" in note for note in record["notes"]) == 4
    assert record["validation"]["elbow"]["rms"] < 0.05
    text = page.read_text()
    for head in ("Data", "Choices", "Residuals", "Parameters", "Model errors", "What cannot be known", "Validation"):
        assert f"<h2>{head}</h2>" in text
    assert text.count("data:image/png;base64,") == 4
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_a_report_shows_names_as_text(tmp_path: Path) -> None:
    robot = tl.load_robot(ARM.visuals.text.replace("forearm", "a&lt;b&gt;"))
    found = tl.identify(robot, T, Q, V, TAU, a=A)
    text = found.report(tmp_path / "report.html", ["<script>"]).read_text()
    assert "a&lt;b&gt;.first_moment.z" in text
    assert "<script>" not in text
    assert "<b>" not in text


def test_odd_logs_are_refused_or_named(log: Path, tmp_path: Path) -> None:
    one_line(call("identify", "arm", str(log), "--units", "degrees"), 2, "the unit 'degrees' is unknown")
    (tmp_path / "map.toml").write_text('t = "time"')
    one_line(call("identify", "arm", str(log), "--columns", str(tmp_path / "map.toml")), 1, "no column 'time'")
    (tmp_path / "map.toml").write_text("t = ")
    one_line(call("identify", "arm", str(log), "--columns", str(tmp_path / "map.toml")), 1, "not TOML")
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "jitter.npz", t=T + rng.uniform(0, 0.01, len(T)), q=Q, tau=TAU)
    read = read_log(ARM, tmp_path / "jitter.npz", decimate=2)
    assert "jitter" in read.notes[0]
    assert len(read.table["t"]) == len(T) // 2
    np.testing.assert_allclose(read.table["tau"][0], TAU[:2].mean(axis=0))
    assert not any("outliers" in note for note in read.notes)


def test_motors_that_move_several_joints_are_read_as_joints(tmp_path: Path) -> None:
    matrix = np.array([[1.0, 0.0], [1.0, 1.0]])
    motors = Q @ np.linalg.inv(matrix).T
    np.savez(tmp_path / "motors.npz", t=T, q=motors, tau=TAU @ matrix)
    read = read_log(ARM, tmp_path / "motors.npz", {"coupling": matrix.tolist()}).table
    np.testing.assert_allclose(read["q"], Q, atol=1e-12)
    np.testing.assert_allclose(read["tau"], TAU, atol=1e-12)


def test_means_of_samples_take_a_quaternion_and_its_negative_for_the_same(tmp_path: Path) -> None:
    """They are those of the log in which no quaternion changes its sign; a coupling is not of (cos, sin)."""
    robot = tl.load_robot(FREE, root="free")
    q = robot.integrate(robot.neutral, np.sin(np.outer(T, np.arange(1.0, 8.0)) / 3))
    signed = q.copy()
    signed[::2, 3:7] *= -1.0
    for name, rows in (("same", q), ("signs", signed)):
        np.savez(tmp_path / f"{name}.npz", t=T, q=rows, tau=np.outer(np.sin(T), np.ones(7)))
    same, signs = (read_log(robot, tmp_path / f"{name}.npz", decimate=4).table["q"] for name in ("same", "signs"))
    np.testing.assert_allclose(robot.difference(same, signs), 0.0, atol=1e-12)
    middle = robot.normalize(q.reshape(-1, 4, robot.nq).mean(axis=1))
    np.testing.assert_allclose(robot.difference(middle, same), 0.0, atol=1e-3)
    with pytest.raises(QueryError, match=r"cos, sin.* do not add up"):
        read_log(robot, tmp_path / "same.npz", {"coupling": np.eye(7).tolist()})


def test_an_exciting_motion_for_the_robot_to_play(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    record = answer("excite", "panda", "--steps", "0", "--rate", "50", "--acceleration", "4", "--lock",
                    "panda_finger_joint1=0", "--lock", "panda_finger_joint2=0", "--out", str(path))  # fmt: skip
    rows = np.genfromtxt(path, delimiter=",", names=True)
    assert record["duration"] == pytest.approx(rows["t"][-1])
    assert abs(np.diff(rows["t"]) - 0.02).max() < 1e-9
    columns = np.column_stack([rows[name] for name in rows.dtype.names])
    assert np.abs(columns[[0, -1], 8:]).max() < 1e-9
    assert np.abs(columns[:, 15:]).max() < 4
    assert {"parameter", "value", "+-"} == set(record["expected"][0])
    one_line(call("excite", "arm", "--rate", "0"), 2, "rate")
