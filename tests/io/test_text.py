"""Texts from files, the numbers and names in them, and tables: alignment, records, HTML."""

from pathlib import Path

import pytest

from tests.refusals import refusal
from twolink.errors import QueryError, SceneError
from twolink.io.tables import parse_csv
from twolink.io.text import Table, kebab_case, parse_number, read_text


@pytest.mark.parametrize(("text", "value"), [("1.5", 1.5), (" -2e-3 ", -2e-3), ("0.1", 0.1), ("1e400", float("inf"))])
def test_numbers_are_read_to_the_last_bit(text: str, value: float) -> None:
    assert parse_number(text) == value


@pytest.mark.parametrize("text", ["", "1_0", "\u0661", "1,5", "0x10", "one"])
def test_texts_that_are_no_numbers(text: str) -> None:
    with pytest.raises(ValueError, match=r"not a number|could not convert"):
        parse_number(text)


def test_files_are_read_up_to_a_limit_and_errors_have_codes(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"\xef\xbb\xbfabc")
    assert read_text(path, SceneError, 6, "shorten it") == "abc"
    path.write_bytes(b"\xff")
    cases = ((path, 6, "not-readable"), (tmp_path, 6, "not-readable"), (Path("/dev/zero"), 6, "too-large"))
    for place, limit, code in cases:
        with refusal(SceneError, code=code):
            read_text(place, SceneError, limit, "shorten it")


def test_csv_errors_count_the_lines_of_the_text_not_the_rows() -> None:
    assert {name: values.tolist() for name, values in parse_csv("a, b\n\n1,2\n3,4\n", "x").items()} == {
        "a": [1, 3],
        "b": [2, 4],
    }
    with refusal(QueryError, "x, line 4: it has 1 cells", code="csv"):
        parse_csv("a,b\n\n1,2\n3\n", "x", QueryError)
    with pytest.raises(QueryError, match="at least one row"):
        parse_csv("a,b\n", "x", QueryError, rows=1)


@pytest.mark.parametrize(("name", "kebab"), [("JointSpring", "joint-spring"), ("JointPD", "joint-pd")])
def test_kebab_case(name: str, kebab: str) -> None:
    assert kebab_case(name) == kebab


TABLE = Table(("name", "nq", "mass"), (("arm", 2, 4.0), ("talos<", None, 90.123456789)))


def test_columns_are_aligned_and_numbers_are_right_aligned() -> None:
    assert str(TABLE) == repr(TABLE) == "name    nq     mass\narm      2        4\ntalos<      90.1235"


def test_iterating_yields_rows_as_dictionaries() -> None:
    assert len(TABLE) == 2
    assert TABLE.to_records() == list(TABLE)
    assert list(TABLE)[1] == {"name": "talos<", "nq": None, "mass": 90.123456789}


def test_select_keeps_the_rows_and_the_order_asked_for() -> None:
    assert TABLE.select("mass", "name") == Table(("mass", "name"), ((4.0, "arm"), (90.123456789, "talos<")))


def test_html_escapes_the_cells() -> None:
    assert "<td>talos&lt;</td>" in TABLE._repr_html_()


def test_an_empty_table_prints_its_columns() -> None:
    assert str(Table(("name", "nq"), ())) == "name  nq"


def test_booleans_and_sequences_are_words() -> None:
    assert str(Table(("a", "b"), ((True, ("x", 1.5)), (False, ())))) == "a    b\nyes  x, 1.5\nno"
