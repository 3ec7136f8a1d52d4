"""One HTML file, to keep and to send: a title, texts, tables and figures."""

import html
from collections.abc import Iterable
from pathlib import Path

from twolink.errors import ShowError
from twolink.io.files import write_atomic
from twolink.io.tables import require_format

_STYLE = ("body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem}"
          "pre{white-space:pre-wrap}table{border-collapse:collapse;font-size:13px}td,th{padding:.15rem .6rem;"
          "border-bottom:1px solid #ddd;text-align:left}.bad{color:#a00}")  # fmt: skip


def write_page(path: Path, title: str, sections: Iterable[tuple[str, str]]) -> Path:
    """Write a page of sections, each a heading as text, or "", and HTML. Returns the path. Raises ShowError."""
    require_format(path, (".html",), ShowError)
    parts = (f"<h2>{html.escape(head)}</h2>{part}" if head else part for head, part in sections if part)
    page = (f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
            f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>{''.join(parts)}</html>\n")  # fmt: skip
    return write_atomic(path, lambda file: file.write(page.encode()), error=ShowError)
