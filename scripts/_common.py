"""What several scripts share: the folder for results, and records as a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from twolink.io.tables import write_table

OUT = Path(__file__).parents[1] / "out"


def write_records(name: str, records: Sequence[Any]) -> Path:
    """Write instances of one dataclass into a file in `out`, a column a field. Returns its path."""
    names = [field.name for field in fields(records[0])]
    columns = {name: np.array([getattr(record, name) for record in records], dtype=object) for name in names}
    return write_table(OUT / name, columns, {})
