"""What several commands print: JSON or text, and the shapes that cannot be drawn."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import typer


def show(record: Any, text: object, as_json: bool) -> None:
    """Print the record as one line of JSON, or the text.

    Arrays are lists and paths are texts. Numbers that are not finite are refused, because JSON has none.
    """
    typer.echo(json.dumps(record, default=_plain, allow_nan=False) if as_json else text)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else os.fspath(value)


def print_address(url: str) -> None:
    """Say where a live playback is."""
    typer.echo(f"playing at {url} (Ctrl-C ends it)")


def print_not_drawn(names: Sequence[str]) -> None:
    """Name the shapes that cannot be drawn, on stderr."""
    typer.echo(f"twolink: not drawn: {', '.join(names)}", err=True)
