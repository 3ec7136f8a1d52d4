"""Tables of named columns: .csv (.gz), .parquet, .npz, .mat, bags of ROS 2; and CSV text whose errors name the line."""

import csv
import gzip
import io
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from twolink.errors import TwolinkError, import_extra
from twolink.io.bags import BAGS, is_bag, read_bag
from twolink.io.files import write_atomic
from twolink.io.text import decode, first_repeated, parse_number

Columns = dict[str, np.ndarray]
SUFFIXES = (".csv", ".parquet", ".npz")


def parse_csv(text: str, where: str, error: type[TwolinkError] = TwolinkError, rows: int = 0) -> Columns:
    """The columns of a CSV text by the names in its first line.

    Parameters
    ----------
    text : str
        Cells separated by commas. Blank lines do not count.
    where : str
        The name of the text for errors.
    error : type
        The class of the errors.
    rows : int
        The smallest number of rows below the header.

    Returns
    -------
    dict
        One array (n,) for each column, in their order.

    Raises
    ------
    error
        Code "csv": no header, too few rows, a name used twice, a row of another length, or a cell without a number.
    """
    lines = list(csv_rows(text, where, error))
    if len(lines) < 1 + rows:
        expected = "a header" + (f" and at least {'one row' if rows == 1 else f'{rows} rows'}" if rows else "")
        what = f"{'it is empty' if not lines else 'there are too few rows'}, expected {expected}"
        raise error(what, where=where, remedy="such as q0,q1,v0,v1 in the first line", code="csv")
    header = [name.strip() for name in lines[0][1]]
    if len(header) == 1 and (other := re.search("[;\t]", header[0])):
        raise error(f"the cells of the header are separated by {other[0]!r}", where=where,
                    remedy="save it with commas between cells, and points in numbers", code="csv")  # fmt: skip
    if all(_is_number(name) for name in header):
        raise error("its first line has numbers", where=where, remedy="give the columns names there, such as t,q0,q1",
                    code="csv")  # fmt: skip
    repeated = first_repeated(header)
    if repeated is not None:
        raise error(f"column {repeated!r} is there twice", where=where, remedy="keep one", code="csv")
    values = np.empty((len(lines) - 1, len(header)))
    for k, (line, cells) in enumerate(lines[1:]):
        if len(cells) != len(header):
            what = f"it has {len(cells)} cells, the header has {len(header)}"
            raise error(what, where=f"{where}, line {line}", remedy="give each row a cell for each column", code="csv")
        try:
            values[k] = [parse_number(cell) for cell in cells]
        except ValueError as failure:
            what, remedy = f"not a row of numbers: {failure}", "check the numbers and their decimal points"
            raise error(what, where=f"{where}, line {line}", remedy=remedy, code="csv") from None
    return dict(zip(header, values.T, strict=True))


def _is_number(text: str) -> bool:
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


def csv_rows(text: str, where: str, error: type[TwolinkError]) -> Iterator[tuple[int, list[str]]]:
    """The line number and the cells of every row that is not blank. Raises `error`."""
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        yield from ((reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells))
    except csv.Error as failure:
        raise error(f"not CSV: {failure}", where=where, remedy="save it as CSV again", code="csv") from None


def write_table(path: Path, columns: Columns, notes: Mapping[str, str]) -> Path:
    """Write columns of equal length to a file of the format that its ending names.

    Parameters
    ----------
    path : Path
        A file that ends in .csv, .parquet, .npz or .mat.
    columns : dict
        Arrays (n,) or (n, k) by name. A .csv or .mat file has no place for the latter.
    notes : mapping
        Texts by name. A .csv file has no place for them.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    TwolinkError
        The format is unknown (code "unknown-format") or the file cannot be written (code "not-writable").
    """
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz, ".mat": _write_mat}
    writer = writers[require_format(path, writers)]
    return write_atomic(path, lambda file: writer(file, columns, notes))


def read_table(path: Path) -> tuple[Columns, dict[str, str]]:
    """The columns and notes of a file that `write_table` wrote, or the joint states of a bag (see `read_bag`).

    Columns of dates are seconds since the first of them.

    Raises
    ------
    TwolinkError
        The format is unknown, or the file cannot be read (code "not-readable", of CSV "csv").
    """
    readers = {".csv": _read_csv, ".csv.gz": _read_csv, ".parquet": _read_parquet, ".npz": _read_npz, ".mat": _read_mat}
    reader = read_bag if is_bag(path) else readers[require_format(path, (*readers, *BAGS))]
    try:
        path.stat()  # pyarrow's own error for a missing file says less
        columns, notes = reader(path)
        return {name: in_seconds(values) for name, values in columns.items()}, notes
    except TwolinkError:
        raise
    except Exception as error:  # whatever a library raises for a damaged file
        detail = " ".join((getattr(error, "strerror", None) or str(error)).split()) or type(error).__name__
        remedy = "check the path, or save it again"
        raise TwolinkError(f"cannot be read: {detail}", where=str(path), remedy=remedy, code="not-readable") from None


def in_seconds(values: np.ndarray) -> np.ndarray:
    """Dates as seconds since the first of them, and spans of time in seconds; other values as they are."""
    if values.dtype.kind == "M":
        values = values - values[:1]
    return values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values


def require_format(path: Path, suffixes: Iterable[str] = SUFFIXES, error: type[TwolinkError] = TwolinkError) -> str:
    """The ending of a path in lower case. Raises `error` (code "unknown-format") when it is none of `suffixes`."""
    suffix, endings = path.suffix.lower(), tuple(suffixes)
    if suffix == ".gz":
        suffix = path.with_suffix("").suffix.lower() + suffix
    if suffix not in endings:
        what = f"{path.suffix or 'no ending'!r} is not a format we know"
        raise error(what, where=str(path), remedy=f"known: {', '.join(endings)}", code="unknown-format")
    return suffix


def _write_csv(file: BinaryIO, columns: Columns, _notes: Mapping[str, str]) -> None:
    text, rows = io.StringIO(newline=""), {name: values for name, values in columns.items() if values.ndim == 1}
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows)
    writer.writerows(np.column_stack([*rows.values()]).tolist())  # floats in their shortest exact form
    file.write(text.getvalue().encode())


def _read_csv(path: Path) -> tuple[Columns, dict[str, str]]:
    raw = path.read_bytes()
    text = decode(gzip.decompress(raw) if path.suffix.lower() == ".gz" else raw, path, TwolinkError)
    return parse_csv(text, str(path)), {}


def _write_parquet(file: BinaryIO, columns: Columns, notes: Mapping[str, str]) -> None:
    pyarrow, parquet = import_extra("pyarrow", "sweeps"), import_extra("pyarrow.parquet", "sweeps")
    lists = {name: pyarrow.FixedSizeListArray.from_arrays(values.ravel(), values.shape[1])
             for name, values in columns.items() if values.ndim == 2}  # fmt: skip
    table = pyarrow.table({**columns, **lists}).replace_schema_metadata(dict(notes))
    parquet.write_table(table, file)


def _read_parquet(path: Path) -> tuple[Columns, dict[str, str]]:
    pyarrow, parquet = import_extra("pyarrow", "sweeps"), import_extra("pyarrow.parquet", "sweeps")

    def numbers(column: Any) -> np.ndarray:
        lists = pyarrow.types.is_fixed_size_list(column.type) or pyarrow.types.is_list(column.type)
        return np.asarray(column.combine_chunks().flatten().to_numpy().reshape(len(column), -1) if lists
                          else column.to_numpy())  # fmt: skip

    table = parquet.read_table(path)
    notes = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items() if not k.startswith(b"ARROW")}
    return {name: numbers(table[name]) for name in table.column_names}, notes


def _write_npz(file: BinaryIO, columns: Columns, notes: Mapping[str, str]) -> None:
    arrays: dict[str, Any] = {**columns, **{f"note:{k}": np.array(v) for k, v in notes.items()}}
    np.savez_compressed(file, **arrays)


def _read_npz(path: Path) -> tuple[Columns, dict[str, str]]:
    with path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise ValueError("it is one array, not an archive of them")
        notes = {k.removeprefix("note:"): str(archive[k]) for k in archive.files if k.startswith("note:")}
        return {k: archive[k] for k in archive.files if not k.startswith("note:")}, notes


def _write_mat(file: BinaryIO, columns: Columns, notes: Mapping[str, str]) -> None:
    """For MATLAB: t, energy, ...; the columns q.JOINT as a matrix q (n, nq) and their names as a cell q_names."""
    from scipy.io import savemat

    arrays: dict[str, Any] = {"notes": dict(notes)}
    for name, values in columns.items():
        letter, _, joint = name.partition(".")
        if values.ndim == 1:
            arrays[letter] = np.column_stack([*([arrays[letter]] if letter in arrays else []), values])
            if joint:
                arrays[f"{letter}_names"] = np.array([*arrays.get(f"{letter}_names", []), joint], dtype=object)
    savemat(file, arrays, long_field_names=True)


def _read_mat(path: Path) -> tuple[Columns, dict[str, str]]:
    from scipy.io import loadmat

    arrays = {k: v for k, v in loadmat(path, simplify_cells=True).items() if not k.startswith("__")}
    notes = {k: str(v) if np.size(v) else "" for k, v in arrays.pop("notes", {}).items()}
    columns: Columns = {}
    for name, values in arrays.items():
        joints = np.atleast_1d(arrays.get(f"{name}_names", []))
        values = np.atleast_1d(values)  # one sample is a number
        table = values.reshape(-1, max(1, len(joints)))
        if not name.endswith("_names"):
            columns |= {f"{name}.{joint}": table[:, k] for k, joint in enumerate(joints)} or {name: values}
    return columns, notes
