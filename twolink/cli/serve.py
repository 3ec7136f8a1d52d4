"""The command that serves the API and the page."""

import os
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from twolink.cli.failures import Misuse
from twolink.errors import import_extra


def serve(
    host: Annotated[str, Option(help="Address to listen on; 0.0.0.0 is all of this machine's.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, metavar="PORT", help="0 takes a free one.")] = 8000,
    data: Annotated[Path | None, Option(help="Folder of the results.", show_default="your user data folder")] = None,
    token: Annotated[list[str] | None, Option(metavar="TEXT", help="Ask for this bearer token; repeatable.")] = None,
    quota: Annotated[list[str] | None, Option(metavar="NAME=NUMBER", help="A limit; --quota help lists them.")] = None,
    allow_host: Annotated[list[str] | None, Option(metavar="NAME", help="Another name of it; repeatable.")] = None,
    allow_origin: Annotated[list[str] | None, Option(metavar="URL", help="Site that may call it; repeatable.")] = None,
) -> None:
    """Serve queries, simulations and the page over HTTP.

    Without --host only this machine reaches it. Addresses always name it; --allow-host adds names. --allow-origin is a
    site whose pages may call it, such as https://lab.example. TWOLINK_TOKEN holds tokens too, with commas between;
    other users of this machine cannot read it. --data is the folder of uploads, jobs and results.

    \b
    twolink serve                                       then open http://127.0.0.1:8000/
    curl -s 127.0.0.1:8000/v1/robots/two_link/forward-dynamics -d '{"q": [0, 0], "tau": [1, 0]}'
    TWOLINK_TOKEN=secret twolink serve --host 0.0.0.0   for others too; they send Authorization: Bearer secret
    twolink serve --quota jobs=4 --quota disk_mb=20000

    The API is described at /docs and /openapi.json; `tl.connect("http://127.0.0.1:8000")` asks it from Python. Results
    survive a restart; the next start names the jobs that were interrupted. Ctrl-C ends the service.
    """
    from twolink.service.settings import Quotas, Settings, default_folder, is_loopback, read_quotas

    if quota and "help" in quota:
        for name, value in zip(Quotas.__struct_fields__, Quotas.__struct_defaults__, strict=True):
            typer.echo(f"{name}={value}")
        return
    tokens = [*(token or []), *os.environ.get("TWOLINK_TOKEN", "").split(",")]
    if any(not part.isascii() for part in tokens):
        raise Misuse("a token has letters beyond ASCII", where="token", remedy="take plain letters and digits")
    settings = Settings(
        data=str(data or default_folder()),
        host=host,
        port=port,
        tokens=tuple(text.strip() for text in tokens if text.strip()),
        hosts=tuple(allow_host or []),
        origins=tuple(allow_origin or []),
        quotas=read_quotas(quota or []),
    )
    if not is_loopback(host) and not settings.tokens:
        typer.echo(f"twolink: anybody who reaches {host} may use it; --token asks for one", err=True)
    server = import_extra("twolink.service.server", "service")
    data_note = f"(data in {settings.data}; Ctrl-C ends it)"
    server.run(settings, on_start=lambda url: typer.echo(f"twolink serves {url}  {data_note}"))
