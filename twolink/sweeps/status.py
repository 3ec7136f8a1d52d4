"""How far a sweep is, from its store: also while it is being computed, by another process."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

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
