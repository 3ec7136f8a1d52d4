"""Texts and the numbers in them: files read within a limit, floats read strictly, names in kebab case; and tables that
print aligned.
"""

from __future__ import annotations

import html
import json
import numbers
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twolink.errors import QueryError, TwolinkError
from twolink.io.files import may_be_read


def read_bytes(path: Path, error: type[TwolinkError], limit: int = -1) -> bytes:
    """The content of a file, at most `limit` + 1 bytes of it: a device may have no end.

    Raises
    ------
    error
        Code "not-readable", or "not-allowed" where `files.confined` does not admit it.
    """
    try:
        if not may_be_read(path):
            raise error("it is outside the folder that files are read in", where=str(path), code="not-allowed",
                        remedy="give a path in the folder")  # fmt: skip
        with path.open("rb") as file:
            return file.read(limit + 1 if limit >= 0 else -1)
    except (OSError, ValueError) as failure:
        raise _not_readable(path, getattr(failure, "strerror", None) or str(failure), error) from None


def read_text(path: Path, error: type[TwolinkError], limit: int, remedy: str) -> str:
    """A UTF-8 file of at most `limit` bytes; `remedy` is for longer ones.

    Raises
    ------
    error
        Code "not-readable" or "too-large".
    """
    data = read_bytes(path, error, limit)
    if len(data) > limit:
        raise error(f"more than {limit} bytes", where=str(path), remedy=remedy, code="too-large")
    return decode(data, path, error)


def decode(data: bytes, path: Path, error: type[TwolinkError]) -> str:
    """UTF-8 bytes as text, without the byte order mark that spreadsheets put first. Raises `error`."""
    try:
        return data.decode("utf-8-sig")
    except ValueError:
        raise _not_readable(path, "it is not UTF-8 text", error) from None


def _not_readable(path: Path, detail: str, error: type[TwolinkError]) -> TwolinkError:
    return error(f"cannot be read: {detail}", where=str(path), remedy="check the path", code="not-readable")


def parse_number(text: str) -> float:
    """A float in ASCII digits with a decimal point, as files and command lines write it.

    Python's float() also takes 1_000 and the digits of other scripts, which other programs do not read.

    Raises
    ------
    ValueError
        The text is no such number.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def parse_numbers(name: str, text: str, remedy: str = 'such as "0.1 0.2"') -> list[Any]:
    """Numbers from "0.1 0.2", "0.1,0.2" or JSON "[0.1, 0.2]"; `remedy` is for other texts."""
    try:
        if text.lstrip().startswith("["):
            values = parse_json(text, name)
            return values if isinstance(values, list) else [values]
        return [parse_number(part) for part in re.split(r"[\s,;]+", text.strip()) if part]
    except ValueError:
        raise QueryError(f"{text!r} is not a list of numbers", argument=name, remedy=remedy) from None


def parse_json(text: str, argument: str, remedy: str = "check that place") -> Any:
    """JSON as Python data; all numbers are floats. Raises QueryError for what is not JSON, or repeats a key."""

    def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated = first_repeated(key for key, _ in pairs)
        if repeated is not None:
            raise QueryError(f"{repeated!r} is there twice", argument=argument, remedy="keep one")
        return dict(pairs)

    try:
        # As a float, an integer of any length is a number or infinite: Python's own refuses long ones.
        return json.loads(text, parse_int=float, object_pairs_hook=unrepeated)
    except json.JSONDecodeError as error:
        raise QueryError(f"not JSON: {error}", argument=argument, remedy=remedy) from None
    except RecursionError:
        raise QueryError("not JSON that can be read: it is nested too deep", argument=argument, remedy=remedy) from None


def first_repeated(names: Iterable[str]) -> str | None:
    """The first name that stands twice, or None."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def kebab_case(class_name: str) -> str:
    """A class's name in lower case with hyphens: JointSpring is joint-spring, DCMotor is dc-motor."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "-", class_name).lower()


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
        """A table of the rows with these columns only."""
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
    """True if a cell is right-aligned; an empty one does not decide."""
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
