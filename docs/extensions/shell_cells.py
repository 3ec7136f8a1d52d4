"""Cells that begin with %%sh or %%writefile NAME: the page shows them without that line, as a command or a file."""

import re
from typing import Any

from docutils import nodes

MAGIC = re.compile(r"%%(sh|writefile (?P<file>\S+\.(?P<suffix>\w+)))\n")
LANGUAGES = {"urdf": "xml", "mjs": "js"}


def show(app: Any, document: nodes.document) -> None:
    """Drop the first line of such cells, and name the file."""
    del app
    for block in list(document.findall(nodes.literal_block)):
        text = block.astext()
        found = MAGIC.match(text)
        if not found:
            continue
        block.rawsource = text[found.end() :]
        block.children = [nodes.Text(block.rawsource)]
        suffix = found["suffix"]
        block["language"] = LANGUAGES.get(suffix, suffix) if suffix else "sh"
        if suffix:
            cell = block.parent
            cell.insert(cell.index(block), nodes.paragraph("", "", nodes.literal("", found["file"])))


def setup(app: Any) -> dict[str, bool]:
    """Register the transform."""
    app.connect("doctree-read", show)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
