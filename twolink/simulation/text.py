"""The common base of results: texts, plain data, a file."""

import dataclasses
import html
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.scenes import Scene

RESULT_FILES = (".json", ".html")


class BaseResult:
    """A result: a full text, one line of it, the text in notebooks, plain data for JSON, a file."""

    def text(self) -> str:
        """All of it for people."""
        return str(self)

    @property
    def summary(self) -> str:
        """One line."""
        return self.text().partition("\n")[0].strip()

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data for JSON; what is not a finite number is None, robots and scenes are their names."""
        fields: Any = self
        return {field.name: as_data(getattr(self, field.name)) for field in dataclasses.fields(fields)}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write `to_dict()` to a .json file, or the text and its figure, if it has one, to an .html page.

        Returns the path.
        """
        target = path_to_write(path)
        if require_format(target, RESULT_FILES) == ".html":
            from twolink.show.figure import figure_html
            from twolink.show.html_page import write_page

            drawn = figure_html(self.plot()) if hasattr(self, "plot") else ""
            return write_page(target, self.summary, [("", BaseResult._repr_html_(self) + drawn)])
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False, default=as_data)
        return write_atomic(target, lambda file: file.write(text.encode()))

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.text())}</pre>"


def as_data(value: Any) -> Any:
    """A value as JSON has it: numbers, texts, lists and dictionaries."""
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return as_data(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [as_data(value.real), as_data(value.imag)]
    if isinstance(value, Scene | Robot):
        return (value.title or value.robot.name) if isinstance(value, Scene) else value.name
    for method in ("to_dict", "to_records"):
        if hasattr(value, method):
            return getattr(value, method)()
    if dataclasses.is_dataclass(value):
        return {field.name: as_data(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(name): as_data(one) for name, one in value.items()}
    return [as_data(one) for one in value] if isinstance(value, Iterable) else str(value)
