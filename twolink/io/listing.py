"""Table: rows with named columns that print aligned, for listings of robots, scenes and methods."""

from __future__ import annotations

import html
import numbers
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, repr=False)
class Table:
    """Rows with named columns. It prints aligned in a terminal and as a table in a notebook.

    Parameters
    ----------
    columns : tuple of str
        The names of the columns.
    rows : tuple of tuple
        One tuple a row, as long as `columns`. Iterating over the table yields each row as a dictionary.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (dict(zip(self.columns, row, strict=True)) for row in self.rows)

    def to_records(self) -> list[dict[str, Any]]:
        """The rows as dictionaries, as JSON and pandas take them."""
        return list(self)

    def select(self, *columns: str) -> Table:
        """The same rows with these columns only."""
        return Table(columns, tuple(tuple(record[name] for name in columns) for record in self))

    def __str__(self) -> str:
        cells = [self.columns, *(tuple(map(_text, row)) for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        numeric = [all(map(_is_number, column)) for column in zip(*self.rows, strict=True)] or [False] * len(widths)
        lines = []
        for row in cells:
            aligned = zip(row, widths, numeric, strict=True)
            lines.append("  ".join(f"{cell:{'>' if right else '<'}{width}}" for cell, width, right in aligned).rstrip())
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self.columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(_text(value))}</td>" for value in row) + "</tr>" for row in self.rows
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def facts_html(title: str, facts: Mapping[str, Iterable[object]]) -> str:
    """A table for notebooks: a row for each fact, its name first, then its values line by line."""
    rows = [(html.escape(name), "<br>".join(html.escape(str(v)) for v in values)) for name, values in facts.items()]
    body = "".join(f"<tr><th>{name}</th><td>{text}</td></tr>" for name, text in rows)
    return f"<table><caption>{html.escape(title)}</caption>{body}</table>"


def _is_number(value: Any) -> bool:
    """Whether a cell is right-aligned; an empty one does not decide."""
    return value is None or (isinstance(value, numbers.Real) and not isinstance(value, bool))


def _text(value: Any) -> str:
    """A cell as text: yes or no, six digits of a float, nothing for None, commas between the items of a sequence."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    return ", ".join(map(_text, value)) if isinstance(value, list | tuple) else str(value)
