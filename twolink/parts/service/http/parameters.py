"""Parameters of the query string that an operation does not take."""

from typing import Any

from litestar import Request
from litestar.params import QueryParameter

from twolink.errors import nearest
from twolink.parts.service.problems import Refusal

OWN_QUERY = "own_query"  # of handlers that check the query string themselves


def require_taken(request: Request[Any, Any, Any]) -> None:
    """Refuse parameters that an operation does not take: a misspelt one would be left out without a word."""
    handler = request.route_handler
    if not request.query_params or not request.url.path.startswith("/v1/") or handler.opt.get(OWN_QUERY):
        return
    given = ((name, field.kwarg_definition) for name, field in handler.parsed_fn_signature.parameters.items())
    taken = [kind.name or name for name, kind in given if isinstance(kind, QueryParameter)]
    for name in request.query_params:
        if name not in taken:
            raise Refusal(400, f"{name[:80]!r} is no parameter here", where="query", code="unknown-parameter",
                          remedy=nearest(name, taken) if taken else "leave it out")  # fmt: skip
