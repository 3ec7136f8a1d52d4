"""Refusals: errors of ours that name the place, the value and the remedy."""

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


@contextlib.contextmanager
def refusal(kind: type[TwolinkError], *parts: str, **fields: object) -> Iterator[None]:
    """Within it an error is raised in one line, with all parts in its text, a remedy, and fields such as its code."""
    with pytest.raises(kind) as caught:
        yield
    text = str(caught.value)
    assert [part for part in parts if part not in text] == [], text
    assert {name: getattr(caught.value, name) for name in fields} == fields
    assert caught.value.remedy
    assert "\n" not in text
