"""Refusals: errors of a kind with a code."""

import contextlib
from collections.abc import Iterator

import pytest

from twolink.errors import TwolinkError


@contextlib.contextmanager
def refused(
    kind: type[TwolinkError], code: str, match: str | None = None
) -> Iterator[pytest.ExceptionInfo[TwolinkError]]:
    """Require that what stands under it raises an error of this kind and code, whose text matches."""
    with pytest.raises(kind, match=match) as caught:
        yield caught
    assert caught.value.code == code
