"""The command identify: files of measurements, a table or JSON, and a URDF."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call, one_line
from tests.identification.motions import motion, noisy
from twolink.errors import QueryError
from twolink.identification.measurements import read_measurements
from twolink.io.tables import write_table

ARM = tl.load_robot("arm")
T, Q, V, A = motion(ARM, 200)
TAU = noisy(ARM.inverse_dynamics(Q, V, A), 0.02)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    columns = {"t": T, "q.shoulder": Q[:, 0], "q.elbow": Q[:, 1], "tau0": TAU[:, 0], "tau1": TAU[:, 1]}
    return write_table(tmp_path / "log.csv", columns, {})


def test_values_intervals_and_what_cannot_be_told(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.urdf"
    record = answer(
        "identify", "arm", str(log), "--parameters", "forearm.mass, forearm.first_moment.*", "--out", str(out)
    )
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
    columns = {"t": T, **{f"{n}{k}": x[:, k] for n, x in (("q", Q), ("v", V), ("a", A), ("tau", TAU)) for k in (0, 1)}}
    read = read_measurements(ARM, write_table(tmp_path / f"log{ending}", columns, {}))
    for name, wanted in (("t", T), ("q", Q), ("v", V), ("a", A), ("tau", TAU)):
        assert np.array_equal(read[name], wanted)


def test_whole_arrays_are_read_and_missing_columns_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU)
    read = read_measurements(ARM, tmp_path / "log.npz")
    assert read["v"] is None
    assert np.array_equal(read["tau"], TAU)
    for lacking in ("t", "q1", "tau0"):
        columns = {"t": T, "q0": Q[:, 0], "q1": Q[:, 1], "tau0": TAU[:, 0], "tau1": TAU[:, 1]}
        del columns[lacking]
        path = write_table(tmp_path / "log.csv", columns, {})
        with pytest.raises(QueryError, match="is missing; there are") as caught:
            read_measurements(ARM, path)
        assert caught.value.code == "column-missing"
