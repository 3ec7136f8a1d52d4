"""The runs of a sweep as a table: one row a run."""

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from twolink.errors import SceneError, require_known
from twolink.io.atomic import write_atomic
from twolink.io.tables import require_format

SUFFIXES = (".csv", ".parquet")
OWN = ("q_name", "v_name", "time")  # dimensions of one run
END = {"q": "q_name", "v": "v_name"}


def run_dims(data: Any) -> tuple[str, ...]:
    """The dimensions of the runs."""
    return tuple(str(name) for name in data["status"].dims)


def column_names(data: Any) -> list[str]:
    """The names of the numbers and texts that every run has: variables, and end.q.JOINT and end.v.JOINT."""
    dims = run_dims(data)
    names = [str(name) for name in data.data_vars if data[name].dims == dims]
    ends = [f"end.{letter}.{joint}" for letter, own in END.items() if letter in data for joint in data[own].values]
    return [*ends, *names]


def column(data: Any, name: str) -> Any:
    """A number or text of every run, as an xarray.DataArray.

    Parameters
    ----------
    data : xarray.Dataset
    name : str
        A variable such as "energy", or "end.q.JOINT" or "end.v.JOINT".

    Raises
    ------
    SceneError
        There is none of this name.
    """
    require_known(name, column_names(data), SceneError, "the sweep has no {!r}", argument="variable")
    if name.startswith("end."):
        _, letter, joint = name.split(".", 2)
        return data[letter].sel({END[letter]: joint}, drop=True)
    return data[name]


def sweep_frame(data: Any) -> Any:
    """A sweep as a pandas.DataFrame: a row a run, with what varies, then the columns of `column_names`."""
    import pandas as pd

    dims = run_dims(data)
    rows = {str(name): data[name].broadcast_like(data["status"]).transpose(*dims).values.ravel()
            for name in data.coords if set(data[name].dims) <= set(dims)}  # fmt: skip
    return pd.DataFrame(rows | {name: column(data, name).values.ravel() for name in column_names(data)})


def write_sweep_table(data: Any, path: str | os.PathLike[str]) -> Path:
    """Write a row for each run into a .csv or .parquet file. Samples stay in the store. Returns the path.

    Raises
    ------
    SceneError
        The path ends otherwise.
    TwolinkError
        The file cannot be written (code "not-writable").
    """
    suffix = require_format(Path(path), SUFFIXES, SceneError)
    frame = sweep_frame(data)

    def write(file: BinaryIO) -> None:
        if suffix == ".csv":
            frame.to_csv(file, index=False, lineterminator="\n")
        else:
            frame.to_parquet(file, index=False)

    return write_atomic(Path(path), write)


def turns_of(data: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Whole turns of a joint at the end, and whether each can be trusted.

    A turn number round(q / 2 pi) is certain where the error bar does not reach the next half turn.
    """
    angle, bar = column(data, name).values, data["error"].values
    turns = np.round(angle / (2.0 * np.pi))
    room = np.pi - np.abs(angle - 2.0 * np.pi * turns)
    with np.errstate(invalid="ignore"):
        return turns, np.isfinite(turns) & (bar < room)
