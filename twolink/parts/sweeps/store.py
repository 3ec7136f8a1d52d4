"""The store of a sweep: Zarr arrays whose chunks are the blocks of runs.

A block's variables are written first and reach the disk; its `status` is written last and marks it. Each file appears
whole or not at all. A block without status, or with runs that are pending in it, is computed again.
"""

import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twolink.errors import SceneError, TwolinkError, import_extra
from twolink.parts.sweeps.design import RUN, Block, blocks
from twolink.parts.sweeps.outputs import PENDING, TEXT, coordinates
from twolink.parts.sweeps.plan import SweepPlan, difference, origin
from twolink.parts.sweeps.runs import Columns

EXTRA = "sweeps"
FORMAT = 1


class SweepStore:
    """The store of a plan. Its arrays by name; path: its folder."""

    def __init__(self, path: Path, plan: SweepPlan, group: Any) -> None:
        self.path, self.plan, self._group = path, plan, group
        self._arrays = {variable.name: group[variable.name] for variable in plan.variables}
        chunks = self._arrays["status"].chunks
        self.blocks_shape: tuple[int, ...] = tuple(int(n) for n in chunks)
        self._finished: set[tuple[int, ...]] = set()

    def note_origin(self) -> None:
        """Add versions and machine of this process to the record, unless they are there."""
        record, here = json.loads(self._group.attrs["twolink"]), origin()
        known = [record, *record.get("resumed", ())]
        if all(any(part[name] != here[name] for name in here if name != "created") for part in known):
            record["resumed"] = [*known[1:], here]
            self._group.attrs["twolink"] = json.dumps(record)

    def pending(self) -> Iterator[tuple[Block, np.ndarray]]:
        """The blocks with runs that are pending, and their numbers (n,) in the block, in C order."""
        marks = self.path / "status" / "c"
        marked = {file.relative_to(marks).parts for file in marks.rglob("*")}
        for block in blocks(self.plan.design.shape, self.blocks_shape):
            index = self._index(block)
            if tuple(map(str, index)) not in marked:  # most blocks of a new sweep, which are not read
                yield block, np.arange(math.prod(part.stop - part.start for part in block))
            elif index not in self._finished:
                left = np.flatnonzero(np.asarray(self._arrays["status"][block]).ravel() == PENDING)
                if left.size:
                    yield block, left
                else:
                    self._finished.add(index)

    def _index(self, block: Block) -> tuple[int, ...]:
        """The numbers of a block along the dimensions, which are in the names of its files."""
        return tuple(part.start // size for part, size in zip(block, self.blocks_shape, strict=True))

    def write(self, block: Block, some: np.ndarray, columns: Columns) -> None:
        """Write the variables (n, ...) of some runs of a block, and mark them.

        Raises TwolinkError, code "not-writable": what was finished before is kept.
        """
        shape = tuple(part.stop - part.start for part in block)
        whole = len(some) == math.prod(shape)
        try:
            for variable in self.plan.variables:  # `status` is the last one
                array = self._arrays[variable.name]
                if variable.name == "status":
                    self._sync(block)
                values = columns[variable.name]
                if not whole:
                    known = np.array(array[block]).reshape(-1, *variable.shape)
                    known[some] = values
                    values = known
                array[block] = values.reshape(*shape, *variable.shape)
        except OSError as error:
            raise TwolinkError(f"cannot be written: {error.strerror or error}", where=str(self.path),
                               remedy="make room and call again: what is done is kept",
                               code="not-writable") from None  # fmt: skip

    def _sync(self, block: Block) -> None:
        """Wait until a block's variables are on the disk, which may write files in another order."""
        index = self._index(block)
        for variable in self.plan.variables[:-1]:
            file = self.path.joinpath(variable.name, "c", *map(str, [*index, *(0 for _ in variable.shape)]))
            with contextlib.suppress(FileNotFoundError):  # a chunk that is all missing has no file
                handle = os.open(file, os.O_RDONLY)
                try:
                    os.fsync(handle)
                finally:
                    os.close(handle)


def open_store(path: Path, plan: SweepPlan) -> SweepStore:
    """The store of a plan: a new one, the old one, or the old one extended by new values.

    Raises
    ------
    SceneError
        The store belongs to another sweep (code "another-sweep", with the difference), or is no store.
    """
    zarr = import_extra("zarr", EXTRA)
    before = _beside(path, "before")
    if before.exists():  # an extension was stopped between its last two steps
        if not path.exists():
            before.rename(path)
        shutil.rmtree(before, ignore_errors=True)
    if not path.exists():
        return SweepStore(path, plan, _create(zarr, path, plan))
    group, record = read_record(path)
    known = record.get("robots", None if plan.robots else {})
    text = "an earlier version did not note the content of files and functions"
    if "functions" in record["plan"] and known is not None:
        now = {name: plan.robots.get(name, content) for name, content in known.items()}
        text = difference(record["plan"], plan.record) or difference(known, now, "robots")
    if text:
        raise _another(path, text, "the same scene and settings")
    if plan.design.kind == "grid":
        plan = plan.ordered(group["status"].metadata.dimension_names)
    find = _places if plan.design.kind == "grid" else _first_places
    places = [find(path, name, np.asarray(group[name][:]), new) for name, new in plan.design.values.items()]
    places = places[: len(plan.design.shape)]
    old = tuple(len(some) for some in places)
    if old == plan.design.shape and all(np.array_equal(some, np.arange(len(some))) for some in places):
        return SweepStore(path, plan, group)
    return _extended(zarr, path, plan, group, record, places)


def read_record(path: Path) -> tuple[Any, dict[str, Any]]:
    """The group of a store and its record. Raises SceneError, code "no-sweep"."""
    zarr = import_extra("zarr", EXTRA)
    try:
        group = zarr.open_group(str(path), mode="r+" if os.access(path, os.W_OK) else "r")
        record = json.loads(group.attrs["twolink"])
        if record["format"] != FORMAT:
            raise ValueError(f"its format is {record['format']}")
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise SceneError(f"it is no store of a sweep: {error!s:.100}", where=str(path), code="no-sweep",
                         remedy="give a new path") from None  # fmt: skip
    return group, record


def _beside(path: Path, what: str) -> Path:
    return path.with_name(f".{path.name}.{what}")


def _create(zarr: Any, path: Path, plan: SweepPlan) -> Any:
    """A new store without results: made beside the path, then moved there whole."""
    made = _beside(path, "new")
    shutil.rmtree(made, ignore_errors=True)
    try:
        _fill_new(zarr, made, plan)
        made.rename(path)
    except OSError as error:
        raise TwolinkError(f"cannot be written: {error.strerror or error}", where=str(path),
                           remedy="check the folder and the disk", code="not-writable") from None  # fmt: skip
    return zarr.open_group(str(path), mode="r+")


def _fill_new(zarr: Any, path: Path, plan: SweepPlan, before: Mapping[str, Any] | None = None) -> Any:
    """A store without results. before: the record of the store whose results it will have."""
    design, robot = plan.design, plan.scene.robot
    path.parent.mkdir(parents=True, exist_ok=True)
    record = {**origin(), **(before or {}), "format": FORMAT, "plan": plan.record, "robots": plan.robots}
    names = " ".join(design.values) if design.kind != "grid" else ""
    about = {"title": plan.scene.title or robot.name, "how": "; ".join(plan.ways), "twolink": json.dumps(record)}
    about |= {"coordinates": names} if names else {}
    group = zarr.create_group(str(path), zarr_format=3, attributes=about)
    for name, values, dim, attributes in _coordinates(plan):
        kind = str if values.dtype == object else values.dtype
        _array(group, name, kind, values.shape, values.shape, (dim,), attributes)[:] = values
    for variable in plan.variables:
        attributes = {"long_name": variable.description} | ({"units": variable.units} if variable.units else {})
        _array(group, variable.name, str if variable.kind == TEXT else variable.kind,
               (*design.shape, *variable.shape), (*plan.sizes, *variable.shape), (*design.dims, *variable.dims),
               attributes, variable.fill)  # fmt: skip
    return group


def _coordinates(plan: SweepPlan) -> Iterator[tuple[str, np.ndarray, str, dict[str, str]]]:
    """Arrays of what varies, the numbers of runs and other coordinates: name, values, dimension, attributes."""
    design = plan.design
    for name, numbers in design.values.items():
        what = design.quantities[name]
        yield name, numbers, name if design.kind == "grid" else RUN, {"units": what.unit, "long_name": what.about}
    if design.kind != "grid":
        yield RUN, np.arange(design.runs), RUN, {"long_name": "number of the run"}
    lengths = json.dumps([joint.name for joint in plan.scene.robot.joints if joint.unit == "m"])  # not angles
    about = {"time": {"units": "s"}, "q_name": {"lengths": lengths}}
    for name, values in coordinates(plan.scene.robot, plan.request).items():
        yield name, values, name, about.get(name, {})


def _array(
    group: Any, name: str, kind: Any, shape: tuple[int, ...], chunks: tuple[int, ...], dims: tuple[str, ...],
    attributes: Mapping[str, str], fill: Any = None,
) -> Any:  # fmt: skip
    """A new array. A NaN that fills it counts as missing for all readers."""
    return group.create_array(name, shape=shape, chunks=tuple(max(1, n) for n in chunks), dtype=kind, fill_value=fill,
                              dimension_names=list(dims), attributes=dict(attributes))  # fmt: skip


def _another(path: Path, what: str, remedy: str) -> SceneError:
    """The error for a store that does not go on."""
    return SceneError(f"it belongs to another sweep: {what}", where=str(path), code="another-sweep",
                      remedy=f"give another path, or {remedy}")  # fmt: skip


def _places(path: Path, name: str, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Indices of the old values among the new ones. Raises SceneError where one is missing."""
    where = {value: i for i, value in enumerate(new.tolist())}
    missing = [value for value in old.tolist() if value not in where]
    if missing:
        raise _another(path, f"{name} had the value {missing[0]!r}, which is not there now",
                       "keep the old values among the new ones")  # fmt: skip
    return np.array([where[value] for value in old.tolist()])


def _first_places(path: Path, name: str, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """The places of the old values, which the new ones begin with. Raises SceneError where they do not."""
    common = min(len(old), len(new))
    other = np.flatnonzero(old[:common] != new[:common])
    if other.size or len(new) < len(old):
        i = int(other[0]) if other.size else common
        now = repr(new[i].item()) if other.size else "not there"
        raise _another(path, f"{name} of run {i} was {old[i].item()!r} and is now {now}",
                       "add values behind the old ones")  # fmt: skip
    return np.arange(len(old))


def _extended(
    zarr: Any, path: Path, plan: SweepPlan, old: Any, record: Mapping[str, Any], places: list[np.ndarray]
) -> SweepStore:  # fmt: skip
    """A store with the old results at their places among the new ones, which replaces the old store."""
    made, before = _beside(path, "new"), _beside(path, "before")
    shutil.rmtree(made, ignore_errors=True)
    store = SweepStore(made, plan, _fill_new(zarr, made, plan, record))
    sources = []
    for some, size in zip(places, plan.design.shape, strict=True):
        source = np.full(size, -1)
        source[some] = np.arange(len(some))
        sources.append(source)
    for block in blocks(plan.design.shape, store.blocks_shape):
        known = [source[part] for source, part in zip(sources, block, strict=True)]
        kept = [np.flatnonzero(some >= 0) for some in known]
        if not all(some.size for some in kept):
            continue
        at = tuple(some[here] for some, here in zip(known, kept, strict=True))
        shape = tuple(part.stop - part.start for part in block)
        rows = np.ravel_multi_index(np.ix_(*kept), shape).ravel()
        columns = {}
        for v in plan.variables:
            whole = (slice(None),) * len(v.shape)
            columns[v.name] = np.asarray(old[v.name].oindex[(*at, *whole)]).reshape(-1, *v.shape)
        store.write(block, rows, columns)
    path.rename(before)
    made.rename(path)
    shutil.rmtree(before, ignore_errors=True)
    return SweepStore(path, plan, zarr.open_group(str(path), mode="r+"))


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the store for this process alone. Raises TwolinkError, code "in-use". The lock ends with the process."""
    try:
        import fcntl
    except ImportError:  # Windows: two processes write the same results
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(_beside(path, "lock"), os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise TwolinkError("another process computes it", where=str(path), code="in-use",
                               remedy="wait for it, or look at its status") from None  # fmt: skip
        yield
    finally:
        os.close(handle)
