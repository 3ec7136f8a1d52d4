"""Parameters that no operation takes: unknown ones of the query string, and names in the path that nothing has."""

from typing import Any

from litestar import Request
from litestar.params import QueryParameter

from twolink.errors import nearest
from twolink.parts.service.problems import Refusal

OWN_QUERY = "own_query"  # of handlers that check the query string themselves


def require_taken(request: Request[Any, Any, Any]) -> None:
    """Refuse parameters that an operation does not take: a misspelt one would be left out without a word.

    PostgreSQL takes no NUL in a text.
    """
    handler = request.route_handler
    if any("\0" in str(name) for name in request.path_params.values()):
        raise Refusal(404, "a name with NUL names nothing", where="path", remedy="give an id as it was answered")
    if not request.query_params or not request.url.path.startswith("/v1/") or handler.opt.get(OWN_QUERY):
        return
    given = ((name, field.kwarg_definition) for name, field in handler.parsed_fn_signature.parameters.items())
    taken = [kind.name or name for name, kind in given if isinstance(kind, QueryParameter)]
    for name in request.query_params:
        if name not in taken:
            raise Refusal(400, f"{name[:80]!r} is no parameter here", where="query", code="unknown-query-parameter",
                          remedy=nearest(name, taken) if taken else "leave it out")  # fmt: skip
