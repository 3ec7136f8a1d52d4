"""Sphinx's settings for the documentation site. scripts/docs builds it."""

import logging
import os
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from twolink import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # for cells that call it
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])

logging.getLogger("traitlets").setLevel(logging.WARNING)

project = "twolink"
author = "the twolink authors"
copyright = f"2026, {author}"  # Sphinx's name
release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "docstrings",
    "generated",
    "gallery",
    "method_pictures",
    "mathml",
    "shell_cells",
    "llms",
]
exclude_patterns = ["extensions", "operating"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
myst_html_meta = {"description lang=en": "Rigid-body dynamics from a URDF: answers you can trust, with their price"}
nb_execution_mode = (
    "force"  # scripts/docs --quick and the tests turn it off; the tests execute the cells in one process
)
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True
default_role = "code"
smartquotes = False  # two hyphens begin an option
toc_object_entries = False
autodoc_typehints = "none"  # the docstrings say types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_param = False  # which would repeat the types and the text of `q, v` for each
napoleon_use_ivar = True
copybutton_prompt_text = "$ "
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "furo"
html_math_renderer = "mathml"
html_title = f"twolink {release}"
html_static_path = ["static"]
html_favicon = "../twolink/parts/service/page/icon.svg"
html_css_files = ["site.css"]
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b5c8f", "color-brand-content": "#0b5c8f"},
    "dark_css_variables": {"color-brand-primary": "#6db9e8", "color-brand-content": "#6db9e8"},
}


def setup(app: Sphinx) -> None:
    """Captions of the navigation say at which level they are headings, as screen readers want."""

    def name_levels(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _tree: object) -> None:
        found = context.get("furo_navigation_tree", "")
        context["furo_navigation_tree"] = found.replace('role="heading"', 'role="heading" aria-level="2"')

    app.connect("html-page-context", name_levels, priority=900)  # after the theme's own
