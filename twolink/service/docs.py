"""The docs page: the OpenAPI document as HTML, made here, with no script and no outside address."""

from __future__ import annotations

import html
import json
from typing import Any

Json = dict[str, Any]
_STYLE = """
:root { color-scheme: light dark }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem }
h2 { margin-top: 2.5rem; text-transform: capitalize }
summary { cursor: pointer; padding: .3rem 0 }
details { border-top: 1px solid #8884; padding: .2rem 0 }
code, pre { font: 14px/1.45 ui-monospace, monospace }
pre { overflow-x: auto; padding: .8rem; background: #8881; border-radius: .3rem }
.method { display: inline-block; min-width: 4rem; font-weight: 700 }
table { border-collapse: collapse } td { padding: .1rem 1rem .1rem 0; vertical-align: top }
"""
_START = """
curl -s localhost:8000/v1/robots/panda/forward-dynamics -H 'Content-Type: application/json' \\
  -d '{"q": [0, 0, 0, -1.5, 0, 1.5, 0, 0, 0]}'
curl -s localhost:8000/v1/robots -H 'Content-Type: application/xml' --data-binary @my_robot.urdf
curl -s localhost:8000/v1/simulations -d '{"scene": "arm-swing", "accuracy": 1e-9}'
"""


def docs_page(document: Json) -> str:
    """The page, grouped by the operations' tags."""
    groups: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            tag = operation.get("tags", ["service"])[0]
            groups.setdefault(tag, []).append(_operation(document, method, path, operation))
    title = html.escape(document["info"]["title"])
    body = "".join(f"<h2>{html.escape(tag)}</h2>{''.join(parts)}" for tag, parts in groups.items())
    intro = html.escape(document["info"].get("description") or "")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width, '
        f'initial-scale=1"><title>{title}: the API</title><style>{_STYLE}</style><h1>{title}: the API</h1>'
        f'<p>{intro} The same as <a href="/openapi.json">OpenAPI 3.1</a>.</p>'
        f"<pre>{html.escape(_START.strip())}</pre>{body}</html>"
    )


def _operation(document: Json, method: str, path: str, operation: Json) -> str:
    summary = html.escape(operation.get("summary", ""))
    parts = [f"<p>{html.escape(operation.get('description') or '')}</p>"]
    rows = "".join(
        f"<tr><td><code>{html.escape(p['name'])}</code><td>{p['in']}<td>{html.escape(_schema(p.get('schema', {})))}"
        for p in operation.get("parameters", [])
    )
    parts += [f"<table>{rows}</table>"] if rows else []
    for media, content in operation.get("requestBody", {}).get("content", {}).items():
        shown = json.dumps(_inlined(document, content.get("schema", {})), indent=1)
        parts.append(f"<p>Body: {html.escape(media)}</p><pre>{html.escape(shown)}</pre>")
    return (
        f'<details><summary><code><span class="method">{method.upper()}</span>{html.escape(path)}</code> {summary}'
        f"</summary>{''.join(parts)}</details>"
    )


def _schema(schema: Json) -> str:
    """A parameter's schema in a few words."""
    if "enum" in schema:
        return " or ".join(map(str, schema["enum"]))
    if "oneOf" in schema or "anyOf" in schema:
        return " or ".join(_schema(s) for s in schema.get("oneOf") or schema["anyOf"])
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
