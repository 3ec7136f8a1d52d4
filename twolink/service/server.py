"""Running the service: uvicorn, in this process or in several."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import socket
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import uvicorn

from twolink.errors import TwolinkError
from twolink.service import metrics
from twolink.service.protocol import Protocol
from twolink.service.settings import Settings

_BACKLOG = 2048
_GRACE = 2  # seconds for answers under way when it is told to end


def run(settings: Settings, on_start: Callable[[str], None]) -> None:
    """Serve until interrupted. on_start: called with the address once it is bound.

    Raises TwolinkError when the address is taken or the data folder cannot be used.
    """
    logging.basicConfig(level=logging.WARNING, format="twolink: %(message)s")
    _allow_many_connections()
    if settings.workers > 1:
        _run_many(settings, on_start)
        return
    from twolink.service.app import build

    config = uvicorn.Config(build(settings), **_options(settings))
    server = _Server(config, on_start)
    listening = _bound(settings)
    with contextlib.suppress(KeyboardInterrupt), listening:
        server.run(sockets=[listening])


def _run_many(settings: Settings, on_start: Callable[[str], None]) -> None:
    """Several processes on one address and one folder."""
    from uvicorn.supervisors import Multiprocess

    from twolink.service.app import ENVIRONMENT

    shared = tempfile.mkdtemp(prefix="twolink-metrics-")
    os.environ[metrics.SHARED_FOLDER] = shared
    os.environ[ENVIRONMENT] = msgspec.json.encode(settings).decode()
    config = uvicorn.Config("twolink.service.app:from_environment", factory=True, workers=settings.workers,
                            **_options(settings))  # fmt: skip
    listening = _bound(settings)
    try:
        on_start(_address(settings.host, listening.getsockname()[1]))
        Multiprocess(config, sockets=[listening]).run()
    finally:
        listening.close()
        shutil.rmtree(shared, ignore_errors=True)


def _bound(settings: Settings) -> socket.socket:
    """The socket to listen on. Raises TwolinkError when it cannot be had."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=_BACKLOG)
    except OSError as error:
        what = f"{settings.host}:{settings.port} cannot be listened on: {error.strerror or error}"
        raise TwolinkError(what, where="serve", remedy="give another --port or --host") from None


def _options(settings: Settings) -> dict[str, Any]:
    Protocol.seconds = settings.quotas.body_seconds
    return {
        "host": settings.host,
        "port": settings.port,
        "http": Protocol,
        "ws": "none",
        "log_level": "warning",
        "access_log": False,
        "server_header": False,
        "date_header": True,
        "lifespan": "on",
        "proxy_headers": False,
        "timeout_keep_alive": 30,
        "timeout_graceful_shutdown": _GRACE,
    }


def _address(host: str, port: int) -> str:
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


class _Server(uvicorn.Server):
    """uvicorn's server, which says when it listens."""

    def __init__(self, config: uvicorn.Config, on_start: Callable[[str], None]) -> None:
        super().__init__(config)
        self._on_start = on_start

    async def startup(self, sockets: Any = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._on_start(_address(self.config.host, sockets[0].getsockname()[1]))


def _allow_many_connections() -> None:
    """As many open files as this user may have: idle clients take one each."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def ensure_folder(path: Path) -> Path:
    """The data folder, made private. Raises TwolinkError."""
    try:
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        what = f"cannot be made: {error.strerror or error}"
        raise TwolinkError(what, where=str(path), remedy="give another --data") from None
    return path
