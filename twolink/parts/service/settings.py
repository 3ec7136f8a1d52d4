"""Settings of the service: address, data folder, access, and quotas; and tokens, some of which a file has.

Such a file is read again when it changes.
"""

import contextlib
import hmac
import ipaddress
import logging
import math
import re
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import msgspec

from twolink.errors import TwolinkError, require_known
from twolink.io.schemas import split_path
from twolink.parts.service.logs import LogForm
from twolink.parts.service.problems import Refusal

Count = Annotated[int, msgspec.Meta(ge=1, le=10**9)]
Amount = Annotated[float, msgspec.Meta(gt=0, le=1e9)]  # which leaves out inf and nan
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")
_ORIGIN = re.compile(r"https?://[^/\s?#@A-Z]+")
_PATH = re.compile(r"(/[A-Za-z0-9._~-]+)+")
_TOKEN = re.compile(r"(?:([A-Za-z0-9_.@-]{1,64}):)?([!-+\--9;-~]+)")  # NAME:TOKEN; a comma separates tokens
_LOOK = 1.0  # s between looks at the file
_log = logging.getLogger("twolink.service")
Token = tuple[str, str, float]  # its owner, its text, and the time until which it opens the service, s since 1970


def _unfit(argument: str, what: str, remedy: str) -> TwolinkError:
    """The failure of a setting that cannot be."""
    return TwolinkError(what, argument=argument, remedy=remedy)


class Quotas(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of a request, a job and the store.

    body_mb: size of a request. json_mb: of one in JSON. upload_mb: unpacked size of a zip. files: in a zip. states: in
    a batch. runs: of a sweep. answer_mb: size of an answer. moving_joints: degrees of freedom of an uploaded robot.
    uploads: robots kept. live: simulations at once that clients watch and pull. load_seconds: for reading a robot or a
    scene, or writing a file. query_seconds: for a batch. memory_mb: of all worker processes together. robots_mb: of the
    robots that stay loaded. jobs: at once. queue: jobs of a client that wait. job_seconds: computing time of a job.
    duration: simulated seconds. samples: of a run. result_mb: size of a result. disk_mb: size of all results and
    uploads together; half of what a result leaves of it is for uploads, the rest for results, and neither takes from
    the other. Of results those not used for longest go first, of the owner who has most. owner_disk_mb: of all that a
    named owner keeps. owner_rate: requests a second of a named owner. owner_seconds: processor time of its work in a
    day (UTC). body_seconds: time in which a request must
    arrive.
    connections: open at once. header_kb: size of a request's line and headers. rate_kb: kB/s at which requests must
    arrive and answers be read. memory_in_flight_mb: of bodies, of what is made of them, and of answers until they are
    read. waiting: requests that wait to be computed. A client may hold at most as many connections, as much memory in
    flight and as many waiting requests as stay free for others.

    Raises TwolinkError where a body or an answer of the allowed size could never be in memory, or a result on disk.
    """

    body_mb: Amount = 128
    json_mb: Amount = 16
    upload_mb: Amount = 256
    files: Count = 500
    states: Count = 1_000_000
    answer_mb: Amount = 96
    moving_joints: Count = 100
    uploads: Count = 1000
    live: Count = 4
    load_seconds: Amount = 20
    query_seconds: Amount = 60
    memory_mb: Amount = 1200
    robots_mb: Amount = 128
    jobs: Count = 2
    queue: Count = 50
    job_seconds: Amount = 600
    duration: Amount = 3600
    samples: Count = 500_000
    runs: Count = 1_000_000
    result_mb: Amount = 256
    disk_mb: Amount = 4096
    owner_disk_mb: Amount = 1e9
    owner_rate: Amount = 1e9
    owner_seconds: Amount = 1e9
    body_seconds: Amount = 120
    connections: Count = 4000
    header_kb: Amount = 32
    rate_kb: Amount = 16
    memory_in_flight_mb: Amount = 512
    waiting: Count = 200

    def __post_init__(self) -> None:
        largest = max(self.body_mb, self.answer_mb)
        if 4 * largest > self.memory_in_flight_mb:  # a client may have half, and needs each twice
            what = f"memory_in_flight_mb = {self.memory_in_flight_mb:g} is less than 4 times the largest body or answer"
            raise _unfit("quota", what, f"give memory_in_flight_mb={4 * largest:g}, or less body_mb and answer_mb")
        if self.result_mb > self.disk_mb:
            what = f"disk_mb = {self.disk_mb:g} is less than result_mb = {self.result_mb:g}"
            what += ": a result would find no room"
            raise _unfit("quota", what, f"give disk_mb={self.result_mb:g} or more, or less result_mb")

    @property
    def uploads_mb(self) -> float:
        """The part of the disk that is for uploaded robots."""
        return (self.disk_mb - self.result_mb) / 2

    @property
    def results_mb(self) -> float:
        """The part of the disk that is for results and drawings."""
        return self.disk_mb - self.uploads_mb


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of a service. data: the folder of everything that is kept.

    tokens: bearer tokens, any of which opens the API; none: no token is asked for. NAME:TOKEN has an owner: who brings
    it lists, cancels and deletes that owner's robots and jobs only; a token without a name has an owner without one.
    token_file: of further ones (`Tokens`), which is read again when it changes. proxies: addresses whose
    X-Forwarded-For is believed.
    admins: names of owners who may do so with those of all. hosts: names the service may be called by, besides
    localhost and plain addresses. origins: of pages that may call it from browsers, besides its own.
    log: the form of its log. delete_results: whether it may start with more results than its quota allows. dask: the
    address of a Dask scheduler that sweeps are sent to; empty: they are computed here. database, store: URLs of a
    PostgreSQL database and of an object store that several services share, each with a folder of its own; empty: this
    service is alone. root_path: the path below which it is, such as /twolink.
    """

    data: str
    host: str = "127.0.0.1"
    port: int = 8000
    tokens: tuple[str, ...] = ()
    token_file: str = ""
    admins: tuple[str, ...] = ()
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()
    proxies: tuple[str, ...] = ()
    quotas: Quotas = Quotas()
    log: LogForm = "text"
    delete_results: bool = False
    dask: str = ""
    database: str = ""
    store: str = ""
    root_path: str = ""

    def __post_init__(self) -> None:
        if not self.data:
            raise _unfit("data", "expected a folder, got ''", "give a path, or leave it out")
        if bool(self.database) != bool(self.store):
            raise _unfit("store" if self.database else "database", "services that share one need the other too",
                         "such as --database postgresql://user@host/name --store s3://bucket/folder")  # fmt: skip
        if self.database and not self.database.startswith(("postgresql://", "postgres://")):
            what = "it is not the URL of a PostgreSQL database"
            raise _unfit("database", what, "such as postgresql://user@host/name")
        if self.root_path and not _PATH.fullmatch(self.root_path):
            what = f"{self.root_path[:80]!r} is not a path"
            raise _unfit("root_path", what, "such as /twolink, without a slash at its end")
        for argument, name in (("host", self.host), *(("allow_host", name) for name in self.hosts)):
            if not _HOST.fullmatch(name) and (ip_address(name) is None or name.startswith("[")):
                remedy = "give a name or an address alone; a port is given with --port"
                raise _unfit(argument, f"{name!r} is not the name of a host", remedy)
        for origin in self.origins:
            if not _ORIGIN.fullmatch(origin):
                remedy = "give scheme and host as browsers send them, such as https://lab.example"
                raise _unfit("allow_origin", f"{origin!r} is not the origin of a page", remedy)
        if not all(map(_TOKEN.fullmatch, self.tokens)):  # the message does not show it
            what = "a token is empty, or has spaces, commas, colons or letters beyond ASCII"
            raise _unfit("token", what, "take plain letters and digits: TOKEN or NAME:TOKEN")
        for proxy in self.proxies:
            if ip_address(proxy) is None:
                raise _unfit("trust_proxy", f"{proxy!r} is not an address", "such as 10.0.0.1")
        for name in self.admins if not self.token_file else ():
            require_known(name, {owner for owner, _ in self.owners if owner}, TwolinkError, argument="admin")

    @property
    def owners(self) -> list[tuple[str, str]]:
        """The owner and the text of each token."""
        return [*filter(None, map(owner_of, self.tokens))]


def owner_of(text: str) -> tuple[str, str] | None:
    """The owner and the token of NAME:TOKEN or TOKEN; None: it is neither."""
    match = _TOKEN.fullmatch(text)
    return None if match is None else (match[1] or "", match[2])


def ip_address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """A host as an address; None when it is a name."""
    try:
        return ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return None


def is_loopback(host: str) -> bool:
    """True if only this machine reaches that host."""
    address = ip_address(host)
    return host == "localhost" if address is None else address.is_loopback


def read_quotas(texts: Sequence[str]) -> Quotas:
    """Quotas from texts such as "jobs=4". Raises TwolinkError for unknown names and values that cannot be."""
    values: dict[str, str] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        require_known(name, Quotas.__struct_fields__, TwolinkError, argument="quota")
        if name in values:
            raise _unfit("quota", f"{name} is given twice", "give it once")
        values[name] = value
    try:
        return msgspec.convert(values, Quotas, strict=False)
    except msgspec.ValidationError as error:
        what, name = split_path(str(error))
        raise _unfit("quota", f"{name}: {what}", "give numbers, such as jobs=4") from None


def open_files() -> float:
    """Allow this process as many open files as its user may have, as each connection takes one; and their number."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return math.inf
    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
        allowed = most
    return math.inf if allowed == resource.RLIM_INFINITY else allowed


class Tokens:
    """Tokens, with their owners and the times at which they end.

    A line of the file is TOKEN or NAME:TOKEN, and the day or time at which it ends (ISO 8601, UTC), if it does; behind
    # is a comment. Raises TwolinkError where the file cannot be used at the start; later the tokens stay as they were.
    """

    def __init__(self, settings: Settings) -> None:
        self._fixed: list[Token] = [(*owner, math.inf) for owner in settings.owners]
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
        compared = [(hmac.compare_digest(sent.strip(), text.encode()), owner, until)
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
        return (*owner, math.inf)
    return (*owner, (until if until.tzinfo else until.replace(tzinfo=UTC)).timestamp())


def _unusable(file: Path, what: str) -> TwolinkError:
    remedy = "lines such as ann:SECRET 2027-01-31"
    return TwolinkError(f"{file.name} cannot be used: {what}", argument="token_file", remedy=remedy)
