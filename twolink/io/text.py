"""Texts and the numbers in them: files read within a limit, floats read strictly, names in kebab case."""

import re
from pathlib import Path

from twolink.errors import TwolinkError


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


def split_path(message: str) -> tuple[str, str]:
    """Split a message of msgspec into what is wrong and the path in the data, such as effects[0].field, or ""."""
    match = re.search(r" - at `(?:key in )?\$?\.?(.*)`$", message, re.DOTALL)
    return (message[: match.start()], match.group(1)) if match else (message, "")


def kebab_case(class_name: str) -> str:
    """A class's name in lower case with hyphens: JointSpring is joint-spring."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", class_name).lower()
