"""Tables of named columns in .csv, .parquet and .npz, written whole or not at all."""

from __future__ import annotations

import csv
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from twolink.errors import TwolinkError, nearest

Columns = dict[str, np.ndarray]
T = TypeVar("T")


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> Path:
    """Write a file beside its place and move it there, so that a reader never sees half of it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise TwolinkError(f"cannot be written: {error.strerror}", where=str(path), remedy="check the folder") from None
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise TwolinkError(f"cannot be written: {error.strerror}", where=str(path), remedy="check the disk") from None
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path


def write_table(path: Path, columns: Columns, notes: Mapping[str, str]) -> Path:
    """Write equally long columns; `notes` are kept where the format has a place for them (not in .csv)."""
    writer = _choose(path, {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz})
    return write_whole(path, lambda file: writer(file, columns, notes))


def read_table(path: Path) -> tuple[Columns, dict[str, str]]:
    """Columns and notes of a file written by `write_table`."""
    reader = _choose(path, {".csv": _read_csv, ".parquet": _read_parquet, ".npz": _read_npz})
    try:
        path.stat()  # pyarrow's own error for a missing file says less
        return reader(path)
    except OSError as error:
        detail = error.strerror or "it is damaged"
        raise TwolinkError(f"cannot be read: {detail}", where=str(path), remedy="check the path") from None
    except (ValueError, KeyError, zipfile.BadZipFile) as error:
        raise TwolinkError(f"cannot be read: {error}", where=str(path), remedy="save it again") from None


def _choose(path: Path, by_suffix: dict[str, T]) -> T:
    if path.suffix not in by_suffix:
        raise TwolinkError(
            f"{path.suffix or 'no ending'!r} is not a format we know",
            where=str(path),
            remedy=nearest(path.suffix, by_suffix),
        )
    return by_suffix[path.suffix]


def _write_csv(file: BinaryIO, columns: Columns, _notes: Mapping[str, str]) -> None:
    lines = [
        ",".join(columns),
        *(",".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()),
    ]
    file.write(("\n".join(lines) + "\n").encode())


def _read_csv(path: Path) -> tuple[Columns, dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    if not rows:
        raise ValueError("it is empty")
    values = np.array([[float(x) for x in row] for row in rows[1:]]).reshape(-1, len(rows[0]))
    return dict(zip(rows[0], values.T, strict=True)), {}


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
    with np.load(path, allow_pickle=False) as archive:
        notes = {k.removeprefix("note:"): str(archive[k]) for k in archive.files if k.startswith("note:")}
        return {k: archive[k] for k in archive.files if not k.startswith("note:")}, notes
