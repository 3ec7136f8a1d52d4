"""Texts and what is in them: files read within a limit, numbers and JSON read strictly, names in kebab case."""

import json
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from twolink.errors import QueryError, TwolinkError


def read_bytes(path: Path, error: type[TwolinkError], limit: int = -1) -> bytes:
    """The content of a file, at most `limit` + 1 bytes of it: a device may have no end.

    Raises
    ------
    error
        Code "not-readable".
    """
    try:
        with path.open("rb") as file:
            return file.read(limit + 1 if limit >= 0 else -1)
    except (OSError, ValueError) as failure:
        raise _not_readable(path, getattr(failure, "strerror", None) or str(failure), error) from None


def read_text(path: Path, error: type[TwolinkError], limit: int, remedy: str) -> str:
    """A UTF-8 file of at most `limit` bytes; `remedy` is for longer ones.

    Raises
    ------
    error
        Code "not-readable" or "too-large".
    """
    data = read_bytes(path, error, limit)
    if len(data) > limit:
        raise error(f"more than {limit} bytes", where=str(path), remedy=remedy, code="too-large")
    return decode(data, path, error)


def decode(data: bytes, path: Path, error: type[TwolinkError]) -> str:
    """UTF-8 bytes as text, without the byte order mark that spreadsheets put first. Raises `error`."""
    try:
        return data.decode("utf-8-sig")
    except ValueError:
        raise _not_readable(path, "it is not UTF-8 text", error) from None


def _not_readable(path: Path, detail: str, error: type[TwolinkError]) -> TwolinkError:
    return error(f"cannot be read: {detail}", where=str(path), remedy="check the path", code="not-readable")


def parse_number(text: str) -> float:
    """A float in ASCII digits with a decimal point, as files and command lines write it.

    Python's float() also takes 1_000 and the digits of other scripts, which other programs do not read.

    Raises
    ------
    ValueError
        The text is no such number.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def parse_numbers(name: str, text: str) -> list[Any]:
    """Numbers from "0.1 0.2", "0.1,0.2" or JSON "[0.1, 0.2]"."""
    try:
        if text.lstrip().startswith("["):
            values = parse_json(text, name)
            return values if isinstance(values, list) else [values]
        return [parse_number(part) for part in re.split(r"[\s,;]+", text.strip()) if part]
    except ValueError:
        raise QueryError(f"{text!r} is not a list of numbers", argument=name, remedy='such as "0.1 0.2"') from None


def parse_json(text: str, argument: str, remedy: str = "check that place") -> Any:
    """JSON as Python data; all numbers are floats. Raises QueryError for what is not JSON, or repeats a key."""

    def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated = first_repeated(key for key, _ in pairs)
        if repeated is not None:
            raise QueryError(f"{repeated!r} is there twice", argument=argument, remedy="keep one")
        return dict(pairs)

    try:
        # As a float, an integer of any length is a number or infinite: Python's own refuses long ones.
        return json.loads(text, parse_int=float, object_pairs_hook=unrepeated)
    except json.JSONDecodeError as error:
        raise QueryError(f"not JSON: {error}", argument=argument, remedy=remedy) from None
    except RecursionError:
        raise QueryError("not our JSON: it is nested too deep", argument=argument, remedy=remedy) from None


def first_repeated(names: Iterable[str]) -> str | None:
    """The first name that stands twice, or None."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def split_path(message: str) -> tuple[str, str]:
    """Split a message of msgspec into what is wrong and the path in the data, such as effects[0].field, or ""."""
    match = re.search(r" - at `(?:key in )?\$?\.?(.*)`$", message, re.DOTALL)
    return (message[: match.start()], match.group(1)) if match else (message, "")


def kebab_case(class_name: str) -> str:
    """A class's name in lower case with hyphens: JointSpring is joint-spring."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", class_name).lower()
