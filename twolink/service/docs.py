"""The docs page: the OpenAPI document as HTML, made here, with no script and no outside address."""

from __future__ import annotations

import json
from html import escape
from typing import Any

Json = dict[str, Any]
_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>twolink: the API</title>
<link rel="stylesheet" href="/page/docs.css"><h1>twolink: the API</h1>"""
_EXAMPLES = """
curl -s localhost:8000/v1/robots/panda/forward-dynamics -H 'Content-Type: application/json' \\
  -d '{"q": [0, 0, 0, -1.5, 0, 1.5, 0, 0, 0]}'
curl -s localhost:8000/v1/robots -H 'Content-Type: application/xml' --data-binary @my_robot.urdf
curl -s localhost:8000/v1/simulations -d '{"scene": "arm-swing", "accuracy": 1e-9}'
"""


def docs_page(document: Json) -> str:
    """The page of an OpenAPI document: operations grouped by their tags, then the schemas they refer to."""
    groups: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            head = f'<span class="method">{method.upper()}</span>{escape(path)}</code> {escape(operation["summary"])}'
            content = {name: operation[name] for name in ("parameters", "requestBody") if name in operation}
            details = _details(head, operation.get("description"), content)
            groups.setdefault(operation.get("tags", ["service"])[0], []).append(details)
    schemas = document["components"]["schemas"]
    groups["schemas"] = [_details(f"{escape(name)}</code>", "", schema) for name, schema in schemas.items()]
    about = escape(document["info"].get("description") or "")
    intro = f'<p>{about} The same as <a href="/openapi.json">OpenAPI 3.1</a>.</p><pre>{escape(_EXAMPLES.strip())}</pre>'
    return _HEAD + intro + "".join(f"<h2>{escape(tag)}</h2>{''.join(parts)}" for tag, parts in groups.items())


def _details(head: str, text: str | None, content: Json) -> str:
    shown = f"<pre>{escape(json.dumps(content, indent=1))}</pre>" if content else ""
    return f"<details><summary><code>{head}</summary><p>{escape(text or '')}</p>{shown}</details>"
