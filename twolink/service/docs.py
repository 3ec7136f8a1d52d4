"""The docs page: the OpenAPI document as HTML, made here, with no script and no outside address."""

import json
from html import escape
from pathlib import Path
from typing import Any

Json = dict[str, Any]
_TEMPLATE = Path(__file__).with_name("page") / "docs.html"


def docs_page(document: Json) -> str:
    """The page of an OpenAPI document: operations grouped by their tags, then the schemas they refer to."""
    groups: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            head = f'<span class="method">{method.upper()}</span>{escape(path)}</code> {escape(operation["summary"])}'
            content = {name: operation[name] for name in ("parameters", "requestBody") if name in operation}
            details = _details(head, operation.get("description", ""), content)
            groups.setdefault(operation.get("tags", ["service"])[0], []).append(details)
    schemas = document["components"]["schemas"]
    groups["schemas"] = [_details(f"{escape(name)}</code>", "", schema) for name, schema in schemas.items()]
    listed = "".join(f"<h2>{escape(tag)}</h2>{''.join(parts)}" for tag, parts in groups.items())
    page = _TEMPLATE.read_text(encoding="utf-8")
    return page.replace("{about}", escape(document["info"]["description"])).replace("{operations}", listed)


def _details(head: str, text: str, content: Json) -> str:
    shown = f"<pre>{escape(json.dumps(content, indent=1))}</pre>" if content else ""
    return f"<details><summary><code>{head}</summary><p>{escape(text)}</p>{shown}</details>"
