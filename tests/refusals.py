"""Refusals: errors of ours that name the place, the value and the remedy."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from twolink.errors import TwolinkError


@contextlib.contextmanager
def refusal(
    kind: type[TwolinkError], *parts: str, match: str | None = None, **fields: object
) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Within it an error is raised in one line, with all parts in its text, a remedy, and fields such as its code."""
    with pytest.raises(kind, match=match) as caught:
        yield caught
    text = str(caught.value)
    assert [part for part in parts if part not in text] == [], text
    assert {name: getattr(caught.value, name) for name in fields} == fields
    assert caught.value.remedy
    assert "\n" not in text
