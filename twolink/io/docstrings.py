"""Texts about parameters, from docstrings in NumPy's style."""

import inspect
import re
from collections.abc import Callable
from typing import Any

_SECTION = re.compile(r"Parameters\n-+\n(.*?)(?:\n\w+\n-+\n|\Z)", re.DOTALL)
_ENTRY = re.compile(r"^(\w[\w, ]*)(?: : [^\n]*)?\n((?:[ ]+[^\n]*(?:\n|\Z)|\n)*)", re.MULTILINE)


def texts_of(function: Callable[..., Any]) -> dict[str, str]:
    """The texts about the parameters of a function, each one line."""
    return texts_in(inspect.getdoc(function) or "")


def texts_in(docstring: str) -> dict[str, str]:
    """The texts about the parameters in a docstring of NumPy's style, each one line."""
    section = _SECTION.search(docstring)
    entries = _ENTRY.findall(section[1]) if section else ()
    return {name.strip(): " ".join(text.split()) for names, text in entries for name in names.split(",")
            if text.strip()}  # fmt: skip
