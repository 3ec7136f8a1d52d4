"""Texts of results: what `repr` says, as HTML for notebooks."""

from __future__ import annotations

import html


def as_html(result: object) -> str:
    """The text of a result as a block of fixed-width HTML."""
    return f"<pre>{html.escape(str(result))}</pre>"
