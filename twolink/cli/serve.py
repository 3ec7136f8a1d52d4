"""The command that serves the API and the page."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from twolink.cli.options import Misuse, misuse
from twolink.errors import import_extra


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(serve)


def serve(
    host: Annotated[
        str, typer.Option(help="The address to listen on; 0.0.0.0 is all of this machine's.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8000,
    data: Annotated[
        Path | None, typer.Option(help="The folder of uploads, jobs and results; your user data folder when left out.")
    ] = None,
    token: Annotated[
        list[str] | None,
        typer.Option(help="Ask clients for this bearer token; repeatable. Better in TWOLINK_TOKEN (comma between)."),
    ] = None,
    quota: Annotated[
        list[str] | None, typer.Option(help="NAME=NUMBER, repeatable; `--quota help` lists them with their values.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Requests a second from one address; 200 beyond this machine, else no limit.")
    ] = None,
    allow_host: Annotated[
        list[str] | None, typer.Option(help="A name the service may be called by, besides addresses; repeatable.")
    ] = None,
    allow_origin: Annotated[
        list[str] | None, typer.Option(help="A site whose pages may call it, such as https://lab.example; repeatable.")
    ] = None,
) -> None:
    """Serve queries, simulations and the page over HTTP, on this machine only unless told otherwise.

    \b
    twolink serve                                       then open http://127.0.0.1:8000/
    curl -s 127.0.0.1:8000/v1/robots/two_link/forward-dynamics -d '{"q": [0, 0], "tau": [1, 0]}'
    TWOLINK_TOKEN=secret twolink serve --host 0.0.0.0   for others too; they send Authorization: Bearer secret
    twolink serve --quota jobs=4 --quota disk_mb=20000

    The API is described at /docs and /openapi.json; `tl.connect("http://127.0.0.1:8000")` asks it from Python. Results
    outlive a restart; what was interrupted is named at the next start. Ctrl-C ends it.
    """
    from twolink.service.settings import OPEN_RATE, Quotas, Settings, default_folder, is_loopback, read_quotas

    if quota and "help" in quota:
        for name, value in zip(Quotas.__struct_fields__, Quotas.__struct_defaults__, strict=True):
            typer.echo(f"{name}={value}")
        return
    with misuse("quota"):
        quotas = read_quotas(quota or [])
    tokens = [*(token or []), *os.environ.get("TWOLINK_TOKEN", "").split(",")]
    if any(not part.isascii() for part in tokens):
        raise Misuse("a token has letters beyond ASCII", where="token", remedy="take plain letters and digits")
    if rate is not None and not 0 < rate < float("inf"):
        raise Misuse(f"expected a number above 0, got {rate}", where="rate", remedy="such as 100")
    local = is_loopback(host)
    settings = Settings(
        data=str(data or default_folder()), host=host, port=port, tokens=tuple(t.strip() for t in tokens if t.strip()),
        hosts=tuple(allow_host or []), origins=tuple(allow_origin or []),
        rate=rate if rate is not None or local else OPEN_RATE, quotas=quotas,
    )  # fmt: skip
    if not local and not settings.tokens:
        typer.echo(f"twolink: anybody who reaches {host} may use it; --token asks for one", err=True)
    server = import_extra("twolink.service.server", "service")
    server.run(
        settings, on_start=lambda url: typer.echo(f"twolink serves {url}  (data in {settings.data}; Ctrl-C ends it)")
    )
