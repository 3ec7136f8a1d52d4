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
    """The page of an OpenAPI document, grouped by the operations' tags."""
    groups: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            tag = operation.get("tags", ["service"])[0]
            groups.setdefault(tag, []).append(_operation(document, method, path, operation))
    about = escape(document["info"].get("description") or "")
    intro = f'<p>{about} The same as <a href="/openapi.json">OpenAPI 3.1</a>.</p><pre>{escape(_EXAMPLES.strip())}</pre>'
    return _HEAD + intro + "".join(f"<h2>{escape(tag)}</h2>{''.join(parts)}" for tag, parts in groups.items())


def _operation(document: Json, method: str, path: str, operation: Json) -> str:
    rows = (
        f"<tr><td><code>{escape(p['name'])}</code><td>{p['in']}<td>{escape(_in_words(p.get('schema', {})))}"
        for p in operation.get("parameters", [])
    )
    bodies = (
        f"<p>Body: {escape(media)}</p><pre>{escape(_pretty(document, content.get('schema')))}</pre>"
        for media, content in operation.get("requestBody", {}).get("content", {}).items()
    )
    return (
        f'<details><summary><code><span class="method">{method.upper()}</span>{escape(path)}</code> '
        f"{escape(operation.get('summary', ''))}</summary><p>{escape(operation.get('description') or '')}</p>"
        f"<table>{''.join(rows)}</table>{''.join(bodies)}</details>"
    )


def _pretty(document: Json, schema: Any) -> str:
    return json.dumps(_inlined(document, schema), indent=1)


def _in_words(schema: Json) -> str:
    """A parameter's schema in a few words."""
    if "enum" in schema:
        return " or ".join(map(str, schema["enum"]))
    if alternatives := schema.get("oneOf") or schema.get("anyOf"):
        return " or ".join(map(_in_words, alternatives))
    default = f", {schema['default']} when left out" if schema.get("default") is not None else ""
    return f"{schema.get('type', 'any')}{default}"


def _inlined(document: Json, schema: Any, depth: int = 0) -> Any:
    """A schema with what it refers to in place."""
    if isinstance(schema, list):
        return [_inlined(document, item, depth) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema and depth < 8:
        name = schema["$ref"].rpartition("/")[2]
        return _inlined(document, document["components"]["schemas"].get(name, {}), depth + 1)
    return {key: _inlined(document, value, depth) for key, value in schema.items()}
