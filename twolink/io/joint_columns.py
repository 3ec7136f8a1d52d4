"""Columns by joint: the names of q, v, a and tau in tables, and their values from a table."""

from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np


class Joint(Protocol):
    """A joint with its entries in q and in v."""

    @property
    def name(self) -> str: ...
    @property
    def q(self) -> slice: ...
    @property
    def v(self) -> slice: ...


def joint_columns(joints: Iterable[Joint], letter: str) -> list[tuple[str, str]]:
    """The columns of "q", "v", "tau" or "a" in their order, each with its joint: q.JOINT, q.JOINT.0, q.JOINT.1, ..."""
    columns = []
    for joint in joints:
        part = joint.q if letter == "q" else joint.v
        size = part.stop - part.start
        columns += [(f"{letter}.{joint.name}" + (f".{k}" if size > 1 else ""), joint.name) for k in range(size)]
    return columns


def read_columns(
    table: Mapping[str, np.ndarray], joints: Iterable[Joint], letter: str
) -> tuple[np.ndarray | None, list[str]]:
    """The values (n, k) of some joints in a table, and the columns that lack for them.

    Columns are q.JOINT, or q0, q1, ... of all joints, or the array q. The values are None where columns lack.
    """
    if letter in table:
        return np.asarray(table[letter]), []
    by_joint = [column for column, _ in joint_columns(joints, letter)]
    numbered = [f"{letter}{i}" for i in range(len(by_joint))]
    wanted = numbered if table.keys() & set(numbered) else by_joint
    lacking = [column for column in wanted if column not in table]
    return None if lacking else np.column_stack([table[column] for column in wanted]), lacking
