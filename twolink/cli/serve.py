"""The command that serves the API and the page."""

import os
from typing import Annotated, Literal

import typer
from typer import Option

from twolink.errors import import_extra


def serve(
    host: Annotated[str, Option(help="Address to listen on; 0.0.0.0 is all of this machine's.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, metavar="PORT", help="0 takes a free one.")] = 8000,
    data: Annotated[
        str | None, Option(metavar="PATH", help="Folder of the results.", show_default="your user data folder")
    ] = None,
    token: Annotated[list[str] | None, Option(metavar="TEXT", help="Ask for this bearer token; repeatable.")] = None,
    quota: Annotated[list[str] | None, Option(metavar="NAME=NUMBER", help="A limit; --quota help lists them.")] = None,
    allow_host: Annotated[list[str] | None, Option(metavar="NAME", help="Another name of it; repeatable.")] = None,
    allow_origin: Annotated[list[str] | None, Option(metavar="URL", help="Site that may call it; repeatable.")] = None,
    log: Annotated[
        Literal["text", "json", "off"], Option(help="Form of the log; off: without a line a request.")
    ] = "text",
    delete_results: Annotated[
        bool, Option("--delete-results", help="Delete results that are beyond the quota.")
    ] = False,
    dask: Annotated[str, Option(metavar="ADDRESS", help="Send sweeps to this Dask scheduler.", show_default="")] = "",
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
    twolink serve --dask tcp://scheduler:8786           one service for a group with a cluster

    The API is described at /docs and /openapi.json; `tl.connect("http://127.0.0.1:8000")` asks it from Python. Results
    survive a restart, and jobs that were not done are taken up by the next start. Ctrl-C ends the service.
    """
    from twolink.service.settings import Quotas, Settings, default_folder, is_loopback, read_quotas

    if quota and "help" in quota:
        for name, value in zip(Quotas.__struct_fields__, Quotas.__struct_defaults__, strict=True):
            typer.echo(f"{name}={value}")
        return
    of_environment = os.environ["TWOLINK_TOKEN"].split(",") if "TWOLINK_TOKEN" in os.environ else ()
    settings = Settings(
        data=str(default_folder()) if data is None else data,
        host=host,
        port=port,
        tokens=tuple(text.strip() for text in (*(token or ()), *of_environment)),
        hosts=tuple(allow_host or []),
        origins=tuple(allow_origin or []),
        quotas=read_quotas(quota or []),
        log=log,
        delete_results=delete_results,
        dask=dask,
    )
    if not is_loopback(host) and not settings.tokens:
        typer.echo(f"twolink: anybody who reaches {host} may use it; --token asks for one", err=True)
    server = import_extra("twolink.service.http.server", "service")
    data_note = f"(data in {settings.data}; Ctrl-C ends it)"
    server.run(settings, on_start=lambda url: typer.echo(f"twolink serves {url}  {data_note}"))
