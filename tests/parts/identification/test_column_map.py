"""Columns of logs: what a map names wins over the log's own columns, none is read twice, what is left is said."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import call, one_line
from tests.parts.identification.motions import columns, motion
from tests.refusals import refusal
from twolink.errors import QueryError
from twolink.identification import read_log
from twolink.io.tables import write_table
from twolink.parts.identification.measurements import measurements_of
from twolink.robots.joint_layout import columns_to_read, read_columns

ARM = tl.load_robot("arm")
T, Q, V, A = motion(ARM, 100)
TAU = ARM.inverse_dynamics(Q, V, A)
GEAR = 2.76


def written(folder: Path, **table: np.ndarray) -> Path:
    return write_table(folder / "log.csv", {"t": T, **table}, {})


def joints(letter: str, names: list[object]) -> dict[str, object]:
    return dict(zip((f"{letter}.shoulder", f"{letter}.elbow"), names, strict=True))


BY_GEAR = {"column": "tau1", "scale": GEAR}
READ = {  # columns, their map, and what is said of them
    "a map of numbers from 0": (columns(enc=Q, tau=TAU / GEAR), joints("q", ["enc0", "enc1"])
                                | joints("tau", [{"column": "tau0", "scale": GEAR}, BY_GEAR]), ""),
    "a map of numbers from 1": ({**columns(enc=Q), "tau1": TAU[:, 0] / GEAR, "tau2": TAU[:, 1]},
                                joints("q", ["enc0", "enc1"]) | joints("tau", [BY_GEAR, "tau2"]), ""),
    "numbers from 1": (dict(zip(("q1", "q2", "tau1", "tau2"), [*Q.T, *TAU.T], strict=True)), None, "read: "),
    "names of other programs": (dict(zip(("shoulder_pos", "elbow_pos", "effort[0]", "effort[1]"), [*Q.T, *TAU.T],
                                         strict=True)), None, "read: "),
    "columns that change places": (columns(q=Q[:, ::-1], tau=TAU[:, ::-1]), {
        "q0": "q1", "q1": "q0", "tau.shoulder": "tau1", "tau.elbow": "tau0"}, ""),
    "what the map leaves": ({"q0": 9 + Q[:, 0], "enc": Q[:, 0], "q1": Q[:, 1], "tau0": TAU[:, 0],
                             "tau1": TAU[:, 1] / GEAR, "bus": T}, {"q.shoulder": "enc", "tau.elbow": BY_GEAR},
                            "columns that are not read: q0, bus"),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_a_map_wins_over_the_logs_own_columns_and_what_is_guessed_or_left_is_said(tmp_path: Path, case: str) -> None:
    table, mapped, said = READ[case]
    read = read_log(ARM, written(tmp_path, **table), mapped)
    np.testing.assert_array_equal(read.table["q"], Q)
    np.testing.assert_allclose(read.table["tau"], TAU, rtol=1e-14)
    assert len(read.notes) == bool(said)
    assert said in "".join(read.notes)


def test_a_column_that_is_mapped_is_not_read_under_its_own_name_too(tmp_path: Path) -> None:
    """tau1, tau2 numbered from 1: with one of them mapped, tau1 must not stand in for the elbow's."""
    log = written(tmp_path, **columns(q=Q), tau1=TAU[:, 0], tau2=TAU[:, 1])
    with refusal(QueryError, code="column-missing", match="is missing"):
        read_log(ARM, log, {"tau.shoulder": "tau1"})
    with refusal(QueryError, code="column-twice", match=r"read twice, as tau.shoulder and as tau.elbow"):
        read_log(ARM, log, joints("tau", ["tau1", "tau1"]))


@pytest.mark.parametrize(("mapped", "text"), [
    ({"q.elbo": "q1"}, "names 'q.elbo'"), ({"current.elbow": "tau1"}, "names 'current.elbow'"),
    ({"tau.elbow": {"column": "tau1", "factor": 2.0}}, "entry 'factor'"),
    ({"tau.elbow": {"column": "tau1", "scale": "2"}}, "expected a number, got '2'"),
])  # fmt: skip
def test_a_map_with_a_name_that_means_nothing_is_refused(tmp_path: Path, mapped: dict[str, object], text: str) -> None:
    with pytest.raises(QueryError, match=text):
        read_log(ARM, written(tmp_path, **columns(q=Q, tau=TAU)), mapped)


def test_two_columns_of_one_joint_are_refused_by_every_reader(tmp_path: Path) -> None:
    table = {"t": T, "q.elbow": Q[:, 1], **columns(q=Q, v=V)}
    path = write_table(tmp_path / "log.csv", table, {})
    scene = tl.Scene(ARM, Q[0], V[0])
    for read in (lambda: measurements_of(ARM, table, "table"), lambda: tl.judge(scene, path),
                 lambda: tl.fit(scene, path, ["forearm.mass"])):  # fmt: skip
        with refusal(
            tl.errors.QueryError, code="column-twice", match=r"'q.elbow' and 'q1' are both q of joint 'elbow'"
        ):
            read()
    states = tmp_path / "states.csv"
    states.write_text("q0,q1,q.elbow\n0,0,1\n")
    one_line(call("query", "arm", "gravity_torque", "--states", str(states)), 1, "are both q of joint 'elbow'")


def test_numbers_count_entries_and_one_joint_is_read_by_its_own() -> None:
    elbow, _ = read_columns(columns(q=Q), ARM.joints[1:], "q")
    assert elbow is not None
    np.testing.assert_array_equal(elbow[:, 0], Q[:, 1])


def test_numbers_do_not_fill_up_names_where_joints_have_several_entries() -> None:
    """With continuous joints q2 may count joints or entries: it is not read beside an angle by name."""
    robot = tl.load_robot("kinova")
    continuous = next(joint.name for joint in robot.joints if joint.kind == "cos-sin")
    wanted = columns_to_read([f"q.{continuous}", "q1", "q2"], robot.joints, "q")
    assert f"q.{continuous}" in wanted
    assert not {"q1", "q2"} & set(wanted)


def test_matrices_with_samples_in_columns_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=T, q=Q.T, tau=TAU.T)
    with pytest.raises(QueryError, match="'q' has 2 rows, 't' has 100; give a row for each sample"):
        read_log(ARM, path)


@pytest.mark.parametrize("lone", ["t", "q", "tau"])
def test_a_number_in_place_of_a_column_is_refused_by_name(lone: str) -> None:
    with pytest.raises(QueryError, match=rf"'?{lone}'? has 1$|{lone}: expected shape|'t' has 1;"):
        tl.identify(ARM, {"t": T, "q": Q, "tau": TAU, lone: 0.5})


def test_units_of_angles_leave_lengths_and_cosines(tmp_path: Path) -> None:
    robot = tl.load_robot("panda")
    rng = np.random.default_rng(0)
    q, v, tau = (rng.uniform(0.01, 0.03, (100, 9)) * np.arange(1, 101)[:, None] / 100 for _ in range(3))
    turning = np.array([np.pi / 180] * 7 + [1.0, 1.0])
    np.savez(tmp_path / "arrays.npz", t=T, q=q / turning, v=v / turning, tau=tau)
    for path in (tmp_path / "arrays.npz", written(tmp_path, **columns(q=q / turning, v=v / turning, tau=tau))):
        read = read_log(robot, path, units=["deg"]).table
        np.testing.assert_allclose(read["q"], q, rtol=1e-12)
        np.testing.assert_allclose(read["v"], v, rtol=1e-12)


def test_a_missing_column_is_told_beside_all_that_there_are() -> None:
    log = ["t", *(f"{name}{k}" for name in "qvi" for k in range(2)), *(f"extra{k}" for k in range(1, 31)), "x"]
    said = "there are t, q0, q1, v0, v1, i0, i1, extra1 to extra30, x; .*map"
    with refusal(QueryError, code="column-missing", match=said):
        measurements_of(tl.load_robot("two_link"), dict.fromkeys(log, np.zeros(3)), "log.csv")
