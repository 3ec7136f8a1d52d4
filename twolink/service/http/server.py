"""Running the service with uvicorn.

The service is one process with a pool of computing processes. The process answers small queries; batches, jobs and
uploads run in the pool. `scripts/benchmarks/service.py` measures how many. Whoever needs more puts several services
behind a reverse proxy.
"""

import contextlib
import functools
import math
import socket
from collections.abc import Callable
from typing import Any

import uvicorn

from twolink.errors import TwolinkError
from twolink.service.http.components import Service
from twolink.service.http.protocol import Limits, Protocol
from twolink.service.logs import configure
from twolink.service.settings import Settings

_BACKLOG = 2048
_GRACE = 2  # seconds for answers under way when it ends


def run(settings: Settings, on_start: Callable[[str], None]) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    settings : Settings
    on_start : callable
        Called with the address once the service listens.

    Raises
    ------
    TwolinkError
        The address is taken, or the data folder cannot be used.
    """
    from twolink.service.http.app import build

    configure(settings.log)
    with contextlib.suppress(KeyboardInterrupt), _listening(settings) as listening:
        host, port = settings.host, listening.getsockname()[1]
        url = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
        app = build(settings)
        server = _Server(uvicorn.Config(app, **uvicorn_options(settings)), app.service, lambda: on_start(url))
        server.run(sockets=[listening])
        if not server.started:
            raise TwolinkError("the service could not start", where="serve", remedy="its log has the reason")


class _Server(uvicorn.Server):
    """uvicorn's server. on_start: called when requests are answered."""

    def __init__(self, config: uvicorn.Config, service: Service, on_start: Callable[[], None]) -> None:
        super().__init__(config)
        self._service, self._on_start = service, on_start

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the application, and listen."""
        await super().startup(sockets)
        if self.started:
            self._on_start()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Tell those who wait for a job, then end as uvicorn does: answers under way have _GRACE seconds."""
        for server in self.servers:
            server.close()
        await self._service.drain()
        await super().shutdown(sockets)


def _listening(settings: Settings) -> socket.socket:
    """The socket to listen on. Raises TwolinkError."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=_BACKLOG)
    except OSError as error:
        what = f"{settings.host}:{settings.port} cannot be listened on: {error.strerror or error}"
        raise TwolinkError(what, where="serve", code="address-in-use", remedy="give another --port or --host") from None


def uvicorn_options(settings: Settings) -> dict[str, Any]:
    """The options of uvicorn.Config."""
    return {
        "http": functools.partial(Protocol, Limits.of(settings.quotas, _open_files())),
        "ws": "none",
        "log_level": "error",  # a warning for each malformed request would fill the log
        "log_config": None,  # its messages go where ours go
        "access_log": False,
        "server_header": False,
        "lifespan": "on",
        "proxy_headers": False,
        "timeout_keep_alive": 30,
        "timeout_graceful_shutdown": _GRACE,
    }


def _open_files() -> float:
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
