"""The tokens of a service: those of its settings, and those of a file, which is read again when it changes."""

import hmac
import logging
import time
from datetime import UTC, datetime
from pathlib import Path

from twolink.errors import TwolinkError
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Settings, owner_of

_LOOK = 1.0  # s between looks at the file
_log = logging.getLogger("twolink.service")
Token = tuple[str, bytes, float]  # its owner, its text, and the time until which it opens the service, s since 1970


class Tokens:
    """Tokens, with their owners and the times at which they end.

    A line of the file is TOKEN or NAME:TOKEN, and the day or time at which it ends (ISO 8601, UTC), if it does; behind
    # is a comment. Raises TwolinkError where the file cannot be used at the start; later the tokens stay as they were.
    """

    def __init__(self, settings: Settings) -> None:
        self._fixed: list[Token] = [(owner, text.encode(), float("inf")) for owner, text in settings.owners]
        self._file = Path(settings.token_file) if settings.token_file else None
        self._of_file: list[Token] = []
        self._stamp, self._looked = 0, 0.0
        self.asked = bool(self._fixed) or self._file is not None  # whether a token is required
        if self._file is not None:
            self._read(self._file)

    def owner(self, authorization: bytes) -> str:
        """The owner of a token. Raises Refusal (401)."""
        kind, _, sent = authorization.partition(b" ")
        now = time.time()
        if self._file is not None and now > self._looked + _LOOK:
            try:
                self._read(self._file)
            except TwolinkError as error:
                _log.error("the tokens stay as they were: %s", error)
        # Each is compared, in constant time.
        compared = [(hmac.compare_digest(sent.strip(), text), owner, until)
                    for owner, text, until in self._fixed + self._of_file]  # fmt: skip
        found = [(owner, until) for is_same, owner, until in compared if is_same]
        remedy = "send Authorization: Bearer TOKEN"
        if kind.lower() != b"bearer" or not found:
            what = "the token is not one of the service's" if authorization else "a token is required"
            raise Refusal(401, what, where="header: Authorization", remedy=remedy)
        owner, until = max(found, key=lambda one: one[1])
        if now >= until:
            raise Refusal(401, "the token has expired", where="header: Authorization", remedy="ask for a new one")
        return owner

    def _read(self, file: Path) -> None:
        """Read the file if it has changed."""
        self._looked = time.time()
        try:
            stamp = file.stat().st_mtime_ns
            if stamp == self._stamp:
                return
            self._stamp = stamp
            lines = file.read_text("utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise _unusable(file, str(error)) from None
        words = [(number, line.partition("#")[0].split()) for number, line in enumerate(lines, 1)]
        self._of_file = [_token(file, number, parts) for number, parts in words if parts]


def _token(file: Path, number: int, parts: list[str]) -> Token:
    """A line of the file. Raises TwolinkError, which does not show the token."""
    owner = owner_of(parts[0])
    try:
        until = datetime.fromisoformat(parts[1]) if len(parts) > 1 else None
    except ValueError:
        owner, until = None, None
    if owner is None or len(parts) > 2:
        raise _unusable(file, f"line {number} is no token with the day at which it ends")
    if until is None:
        return (*owner, float("inf"))
    return (*owner, (until if until.tzinfo else until.replace(tzinfo=UTC)).timestamp())


def _unusable(file: Path, what: str) -> TwolinkError:
    remedy = "lines such as ann:SECRET 2027-01-31"
    return TwolinkError(f"{file.name} cannot be used: {what}", argument="token_file", remedy=remedy)
