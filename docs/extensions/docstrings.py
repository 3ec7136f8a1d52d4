"""Docstrings are plain text with formulas: what reStructuredText would take as markup is escaped."""

import re
from typing import Any

_properties: dict[str, list[str]] = {}  # docstrings, while napoleon reads them
MARKUP = re.compile(r"``.*?``|`[^`]*`|[|*\\]|(?<=\w)_(?!\w)")


def escaped(line: str) -> str:
    """A line with |, *, backslashes and trailing underscores as themselves; what is in backticks stays."""
    return MARKUP.sub(lambda found: found[0] if found[0].startswith("`") else "\\" + found[0], line)


def as_text(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Escape a docstring, and set indented formulas and tables as they are."""
    del app, what, name, thing, options
    out: list[str] = []
    literal = False
    before = ""  # the last line that is not empty
    for i, line in enumerate(lines):
        indented = line.startswith("    ")
        starts = indented and i > 0 and not lines[i - 1].strip() and before and not before.startswith(" ")
        if starts and not re.fullmatch(r"-{3,}", before):
            out += ["::", ""]
            literal = True
        elif line.strip() and not indented:
            literal = False
        out.append(line if literal or line.lstrip().startswith("* ") else escaped(line))
        before = line if line.strip() else before
    lines[:] = out


def as_prose(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Keep the docstring of a property from napoleon, which takes what is before a colon for its type."""
    del app, thing, options
    if what != "property":
        return
    if name not in _properties:
        _properties[name] = list(lines)
    else:
        lines[:] = _properties.pop(name)


def setup(app: Any) -> dict[str, bool]:
    """Register the hooks, before napoleon's and round it."""
    app.connect("autodoc-process-docstring", as_text, priority=400)
    for priority in (450, 550):  # napoleon has 500
        app.connect("autodoc-process-docstring", as_prose, priority=priority)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
