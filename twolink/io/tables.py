"""Files: written whole or not at all; texts within a limit; tables of named columns in .csv, .parquet and .npz."""

from __future__ import annotations

import csv
import io
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from twolink.errors import SceneError, TwolinkError, nearest

Columns = dict[str, np.ndarray]
SUFFIXES = (".csv", ".parquet", ".npz")


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> Path:
    """Write a file beside its place and move it there, so that a reader never sees half of it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise _unwritten(path, error, "check the folder") from None
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise _unwritten(path, error, "check the disk") from None
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path


def _unwritten(path: Path, error: OSError, remedy: str) -> TwolinkError:
    return TwolinkError(f"cannot be written: {error.strerror or error}", where=str(path), remedy=remedy)


def read_text(path: Path, limit: int, remedy: str) -> str:
    """A UTF-8 file of a scene, of which no more is read than `limit` bytes: some have no end. Raises SceneError."""
    try:
        with path.open("rb") as file:
            data = file.read(limit + 1)
        text = data.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        detail = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise SceneError(f"cannot be read: {detail}", where=str(path), remedy="check the path") from None
    if len(data) > limit:
        raise SceneError(f"more than {limit} bytes", where=str(path), remedy=remedy)
    return text


def write_table(path: Path, columns: Columns, notes: Mapping[str, str]) -> Path:
    """Write equally long columns; `notes` are kept where the format has a place for them (not in .csv)."""
    writer = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz}[require_format(path)]
    return write_whole(path, lambda file: writer(file, columns, notes))


def read_table(path: Path) -> tuple[Columns, dict[str, str]]:
    """Columns and notes of a file written by `write_table`."""
    reader = {".csv": _read_csv, ".parquet": _read_parquet, ".npz": _read_npz}[require_format(path)]
    try:
        path.stat()  # pyarrow's own error for a missing file says less
        return reader(path)
    except OSError as error:
        detail = error.strerror or "it is damaged"
        raise TwolinkError(f"cannot be read: {detail}", where=str(path), remedy="check the path") from None
    except Exception as error:  # whatever a back end raises for a damaged file
        detail = " ".join(str(error).split()) or type(error).__name__
        raise TwolinkError(f"cannot be read: {detail}", where=str(path), remedy="save it again") from None


def require_format(path: Path, known: Iterable[str] = SUFFIXES) -> str:
    """The ending of a path in small letters. Raises TwolinkError when it is none of the known."""
    suffix, endings = path.suffix.lower(), tuple(known)
    if suffix not in endings:
        raise TwolinkError(
            f"{path.suffix or 'no ending'!r} is not a format we know",
            where=str(path),
            remedy=nearest(suffix, endings),
        )
    return suffix


def _write_csv(file: BinaryIO, columns: Columns, _notes: Mapping[str, str]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(np.column_stack([*columns.values()]).tolist())  # floats in their shortest exact form
    file.write(text.getvalue().encode())


def _read_csv(path: Path) -> tuple[Columns, dict[str, str]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    if not rows:
        raise ValueError("it is empty")
    header = rows[0]
    repeated = next((name for i, name in enumerate(header) if name in header[:i]), None)
    if repeated is not None:
        raise ValueError(f"column {repeated!r} is there twice")
    uneven = next((i for i, row in enumerate(rows) if len(row) != len(header)), None)
    if uneven is not None:
        raise ValueError(f"row {uneven} has {len(rows[uneven])} cells, the header has {len(header)}")
    values = np.array([[float(x) for x in row] for row in rows[1:]]).reshape(-1, len(header))
    return dict(zip(header, values.T, strict=True)), {}


def _write_parquet(file: BinaryIO, columns: Columns, notes: Mapping[str, str]) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table(columns).replace_schema_metadata(dict(notes))
    pyarrow.parquet.write_table(table, file)


def _read_parquet(path: Path) -> tuple[Columns, dict[str, str]]:
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    notes = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items() if not k.startswith(b"ARROW")}
    return {name: table[name].to_numpy() for name in table.column_names}, notes


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
