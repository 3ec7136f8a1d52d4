"""The results of a sweep: how far it is, also while another process computes it, and its runs as a table."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from twolink.errors import SceneError, require_known
from twolink.io.files import write_atomic
from twolink.io.tables import require_format
from twolink.sweeps.outputs import STATUS
from twolink.sweeps.store import read_record

RECENT = 20  # blocks, from whose times the rate is told


@dataclass(frozen=True, repr=False)
class SweepStatus:
    """The runs of a sweep by their status.

    total; pending, done, inaccurate, failed, abandoned: numbers of runs. rate, 1/s: of the last blocks; seconds_left:
    at that rate; None where that cannot be told, or nothing is left.
    """

    total: int
    pending: int
    done: int
    inaccurate: int
    failed: int
    abandoned: int
    rate: float | None
    seconds_left: float | None

    def to_dict(self) -> dict[str, Any]:
        """The numbers by name."""
        return asdict(self)

    def __repr__(self) -> str:
        finished = self.total - self.pending
        parts = [f"{finished:,} of {self.total:,} runs finished ({finished / self.total:.1%})"]
        parts += [f"{n:,} {name}" for name, n in self._others() if n]
        if self.rate is not None and self.seconds_left is not None:
            parts.append(f"{self.rate:.4g} runs/s, {self.seconds_left:.0f} s left at that rate")
        return "; ".join(parts)

    def _others(self) -> tuple[tuple[str, int], ...]:
        return ("inaccurate", self.inaccurate), ("failed", self.failed), ("abandoned", self.abandoned)


def sweep_status(path: str | os.PathLike[str]) -> SweepStatus:
    """How far a sweep is.

    Parameters
    ----------
    path : path-like
        Its store.

    Raises
    ------
    SceneError
        It is no store of a sweep; code "no-sweep".
    """
    array = read_record(Path(path))[0]["status"]
    counts, times = np.zeros(len(STATUS), dtype=int), []
    for file in sorted((Path(path) / "status" / "c").rglob("*")):
        if not file.is_file() or file.name.endswith(".partial"):
            continue
        index = tuple(int(part) for part in file.relative_to(Path(path) / "status" / "c").parts)
        numbers = np.bincount(np.asarray(array.blocks[index]).ravel(), minlength=len(STATUS))
        counts += numbers
        times.append((file.stat().st_mtime, int(numbers[1:].sum())))
    counts[0] = array.size - counts[1:].sum()
    recent = sorted(times)[-RECENT:]
    elapsed = recent[-1][0] - recent[0][0] if len(recent) > 1 else 0.0
    rate = sum(n for _, n in recent[1:]) / elapsed if elapsed > 0.0 and counts[0] else None
    by_name = {name: int(n) for name, n in zip(STATUS, counts, strict=True)}
    return SweepStatus(array.size, rate=rate, seconds_left=counts[0] / rate if rate else None, **by_name)


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
