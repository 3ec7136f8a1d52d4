"""Tests for twolink.io.schemas."""

from __future__ import annotations

import time
from typing import Annotated, Any, Literal

import msgspec
import pytest

from twolink.io.schemas import misfit, split_path


class Leg(msgspec.Struct, tag_field="kind", tag="leg", forbid_unknown_fields=True):
    length: float = 0.0
    side: Annotated[Literal["left", "right"] | None, msgspec.Meta(description="which")] = None


class Wheel(msgspec.Struct, tag_field="kind", tag="wheel", forbid_unknown_fields=True):
    radius: float = 0.0


class Machine(msgspec.Struct, forbid_unknown_fields=True):
    parts: tuple[Leg | Wheel, ...] = ()
    spare: dict[str, Leg] = {}
    pair: tuple[float, Leg] | None = None


@pytest.mark.parametrize(("message", "what", "path"), [
    ("Expected `float`, got `str` - at `$.effects[0].field`", "Expected `float`, got `str`", "effects[0].field"),
    ("Expected `float` - at `key in $.q`", "Expected `float`", "q"),
    ("unknown field `x`", "unknown field `x`", ""),
    ("unknown field `x` - at `$`", "unknown field `x`", ""),
])  # fmt: skip
def test_messages_of_msgspec_are_split_into_the_reason_and_the_path(message: str, what: str, path: str) -> None:
    assert split_path(message) == (what, path)


@pytest.mark.parametrize(("data", "path", "remedy"), [
    ({"prts": []}, "", "did you mean 'parts'?"),
    ({"parts": [{"kind": "leg"}, {"kind": "wheel", "radus": 1}]}, "parts[1]", "did you mean 'radius'?"),
    ({"parts": [{"kind": "weel"}]}, "parts[0].kind", "did you mean 'wheel'?"),
    ({"spare": {"a": {"kind": "leg", "side": "lft"}}}, "spare[...].side", "did you mean 'left'?"),
    ({"spare": {"a": {"kind": "leg", "side": "x"}}}, "spare[...].side", "known: left, right"),
    ({"pair": [1.0, {"kind": "leg", "lenght": 1}]}, "pair[1]", "did you mean 'length'?"),
    ({"parts": 1}, "parts", ""),
])  # fmt: skip
def test_the_remedy_is_the_nearest_name_that_stands_there(data: Any, path: str, remedy: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(data, Machine)
    _, where, said = misfit(caught.value, Machine)
    assert (where, said) == (path, remedy)


def test_a_name_of_megabytes_is_not_compared() -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert({"ab" * 1_000_000: 1}, Machine)
    begin = time.process_time()
    assert misfit(caught.value, Machine)[2] == "known: parts, spare, pair"
    assert time.process_time() - begin < 0.3
