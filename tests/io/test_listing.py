"""Table: alignment, records, HTML."""

from twolink.io.text import Table

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
