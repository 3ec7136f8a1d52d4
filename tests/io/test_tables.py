"""Tables: every digit survives, and a damaged file gives one error of one line."""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.refusals import refusal
from twolink.errors import MissingExtraError, TwolinkError
from twolink.io.tables import read_table, write_table


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".CSV", ".Npz"])
def test_any_name_and_every_digit_survive(suffix: str, tmp_path: Path) -> None:
    columns = {name: np.array([0.1, 1e-300, -np.pi]) for name in ("t", "a,b", 'a"b', "a b", "\u00e4")}
    path = write_table(tmp_path / f"x{suffix}", columns, {"note": "yes, \u00e4"})
    again, notes = read_table(path)
    assert list(again) == list(columns)
    for name, values in columns.items():
        assert np.array_equal(again[name], values)
    assert notes == ({} if suffix.lower() == ".csv" else {"note": "yes, \u00e4"})


@pytest.mark.parametrize(("name", "content", "part"), [
    ("x.csv", b"t,t\n0,0\n", "column 't' is there twice"),
    ("x.csv", b"t,q\n0\n", "line 2: it has 1 cells, the header has 2"),
    ("x.csv", b"t\n" + b"0" * 200_000 + b"\n", "field larger"),
    ("x.csv", b"t\n1_0\n", "line 2: not a row of numbers"),
    ("x.csv", b"0,0,1\n0.1,0,1\n", "its first line has numbers; give the columns names there"),
    ("x.csv", b"", "it is empty, expected a header"),
    ("x.csv", b"\xff\xfe", "cannot be read"),
    ("x.npz", b"\x93NUMPY", "cannot be read"),
    ("x.npz", b"PK\x03\x04", "cannot be read"),
    ("x.parquet", b"PAR1PAR1", "cannot be read"),
    ("x.json", json.dumps({}).encode(), "'.json' is not a format we know"),
])  # fmt: skip
def test_damaged_files_give_one_error_of_one_line(name: str, content: bytes, part: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with refusal(TwolinkError, part):
        read_table(tmp_path / name)


def test_a_single_array_is_no_archive(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", np.zeros(3))
    (tmp_path / "x.npy").rename(tmp_path / "x.npz")
    with pytest.raises(TwolinkError, match="one array"):
        read_table(tmp_path / "x.npz")


def test_dates_are_seconds_since_the_first(tmp_path: Path) -> None:
    times = np.array(["2026-11-29T10:00:00", "2026-11-29T10:00:00.25", "2026-11-29T10:01:00"], "datetime64[ns]")
    pd.DataFrame({"t": times, "since": times - times[0], "q": [0.0, 1.0, 2.0]}).to_parquet(tmp_path / "x.parquet")
    table = read_table(tmp_path / "x.parquet")[0]
    for name in ("t", "since"):
        np.testing.assert_array_equal(table[name], [0.0, 0.25, 60.0])
    np.testing.assert_array_equal(table["q"], [0.0, 1.0, 2.0])


def test_the_byte_order_mark_of_spreadsheets_is_skipped(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"\xef\xbb\xbft\r\n\r\n1\r\n")
    assert read_table(tmp_path / "x.csv")[0] == {"t": [1.0]}


def test_parquet_without_its_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_table(tmp_path / "x.parquet", {"t": np.zeros(2)}, {})
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for ask in (lambda: read_table(path), lambda: write_table(tmp_path / "y.parquet", {"t": np.ones(2)}, {})):
        with pytest.raises(MissingExtraError, match=r"pyarrow is not installed.*twolink\[sweeps\]"):
            ask()
    assert not (tmp_path / "y.parquet").exists()
