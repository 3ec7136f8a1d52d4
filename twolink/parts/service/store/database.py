"""The database of a service: SQLite in its data folder, or PostgreSQL by its URL, in the SQL that both know.

Values stand as `?`. Beyond it both have `octet_length`; the time of the database, which is one for all processes, is
`clock`, and `skip_locked` passes over rows that another process is about to claim.
"""

import errno
import sqlite3
import time
from pathlib import Path
from typing import Any, cast

import msgspec

from twolink.errors import TwolinkError, import_extra

EXTRA = "cluster"
VERSION = 4  # of the tables
_SILENT = 20_000  # ms after which a server that does not answer is given up


class SQLite:
    """A database of one process. shared: whether other processes use it at the same time."""

    shared, clock, skip_locked = False, "clock()", ""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        connection.create_function("clock", 0, time.time)
        connection.create_function("octet_length", 1, lambda text: len(text.encode()), deterministic=True)
        self.close = connection.close

    def execute(self, statement: str, values: tuple[Any, ...] = ()) -> list[Any]:
        """The rows of a statement, which is a transaction of its own. Raises sqlite3.Error or OSError."""
        return self._connection.execute(statement, values).fetchall()

    def check(self) -> None:
        """Raise sqlite3.Error or OSError unless it can be written."""
        version = self.execute("PRAGMA user_version")[0][0]
        self.execute(f"PRAGMA user_version = {version}")


class PostgreSQL:
    """A database of several processes. What fails is an OSError; the next statement connects again.

    Raises TwolinkError where it cannot be used.
    """

    shared, clock, skip_locked = True, "extract(epoch FROM clock_timestamp())", "FOR UPDATE SKIP LOCKED"

    def __init__(self, url: str) -> None:
        self._psycopg = import_extra("psycopg", EXTRA)
        self._url, self._connection = url, cast(Any, None)
        try:
            self.execute(Path(__file__).with_name("schema_postgresql.sql").read_text("utf-8"))
            version = self.execute("SELECT max(version) FROM secrets")[0][0]
        except OSError as error:
            raise self._unusable(error.strerror or "", "check --database: the server, the name, the password") from None
        if version > VERSION:
            what = f"it is of a newer version of twolink ({version}, this one has {VERSION})"
            raise self._unusable(what, "install that version")

    @staticmethod
    def _unusable(what: str, remedy: str) -> TwolinkError:
        return TwolinkError(f"the database cannot be used: {what}", where="serve", code="data", remedy=remedy)

    def execute(self, statement: str, values: tuple[Any, ...] = ()) -> list[Any]:
        """As of SQLite."""
        try:
            if self._connection is None or self._connection.closed:
                self._connection = self._psycopg.connect(
                    self._url, autocommit=True, cursor_factory=self._psycopg.ClientCursor, connect_timeout=10,
                    tcp_user_timeout=_SILENT,
                )  # fmt: skip
            cursor = self._connection.execute(statement.replace("?", "%s"), values)
            return cursor.fetchall() if cursor.description else []
        except self._psycopg.Error as error:
            raise OSError(errno.EIO, " ".join(str(error).split())) from None

    def check(self) -> None:
        """As of SQLite."""
        self.execute("UPDATE secrets SET version = version")

    def close(self) -> None:
        """Let go of it."""
        if self._connection is not None:
            self._connection.close()


Database = SQLite | PostgreSQL


def length(column: str) -> str:
    """SQL: the bytes of a text."""
    return f"octet_length(coalesce({column}, ''))"


def plain(values: dict[str, Any]) -> dict[str, Any]:
    """Values for the database: what is not a number, a text or None as JSON."""
    simple = int, float, str, type(None)
    return {name: v if isinstance(v, simple) else msgspec.json.encode(v).decode() for name, v in values.items()}
