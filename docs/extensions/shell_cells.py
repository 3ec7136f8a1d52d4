"""Cells that begin with %%sh or %%writefile NAME: the page shows them without that line, as a command or a file."""

import os
import re
import tempfile
from pathlib import Path
from typing import Any

from docutils import nodes

MAGIC = re.compile(r"%%(sh|writefile (?P<file>\S+\.(?P<suffix>\w+)))\n")
# IPython's own %%sh writes the output in pieces of 100 characters, which a page shows as lines.
STARTUP = """
import subprocess

def sh(line, cell):
    done = subprocess.run(["bash", "-ec", cell], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    print(done.stdout, end="")
    done.check_returncode()

get_ipython().register_magic_function(sh, "cell", "sh")
"""
LANGUAGES = {"urdf": "xml", "xacro": "xml", "mjs": "js"}


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
    """Register the transform, and a start-up file of the kernels."""
    folder = Path(tempfile.mkdtemp(prefix="twolink-docs-"))
    (folder / "profile_default" / "startup").mkdir(parents=True)
    (folder / "profile_default" / "startup" / "sh.py").write_text(STARTUP, "utf-8")
    (folder / "profile_default" / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n", "utf-8")
    os.environ["IPYTHONDIR"] = str(folder)
    app.connect("doctree-read", show)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
