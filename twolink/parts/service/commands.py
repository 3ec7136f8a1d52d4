"""The commands of the service: over HTTP, and of tools for agents."""

import os
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import platformdirs
import typer
from typer import Option

from twolink.errors import TwolinkError, import_extra, require_extra, require_known
from twolink.io.text import read_text


def _with_file(context: typer.Context, path: Path | None) -> Path | None:
    """Let options that are not given be those of a file."""
    if path is None:
        return None
    known = {name for param in context.command.params if (name := param.name) not in (None, "settings", "help")}
    try:
        text = read_text(path, TwolinkError, 2**16, "give a smaller file")
        values = {name.replace("-", "_"): value for name, value in tomllib.loads(text).items()}
    except tomllib.TOMLDecodeError as error:
        raise TwolinkError(str(error), where=path.name, remedy='lines such as host = "0.0.0.0"') from None
    for name in values:
        require_known(name, known, TwolinkError, where=path.name)
    context.default_map = values
    return path


SettingsFile = Annotated[
    Path | None,
    Option(metavar="PATH", is_eager=True, callback=_with_file, show_default=False, help="TOML file of these options."),
]
Data = Annotated[
    str | None, Option(metavar="PATH", help="Folder of the results.", show_default="your user data folder")
]
Log = Annotated[Literal["text", "json", "off"], Option(help="Form of the log; off: without a line a request.")]
DeleteResults = Annotated[bool, Option("--delete-results", help="Delete results that are beyond the quota.")]
Token = Annotated[
    list[str] | None, Option(metavar="TEXT", help="Ask for this bearer token, NAME:TOKEN of an owner; repeatable.")
]
TokenFile = Annotated[
    str, Option(metavar="PATH", help="Tokens, one a line, with the day at which each ends.", show_default=False)
]
Proxy = Annotated[list[str] | None, Option(metavar="ADDRESS", help="Its X-Forwarded-For is believed; repeatable.")]
Admin = Annotated[list[str] | None, Option(metavar="NAME", help="Owner who manages what all have; repeatable.")]
Database = Annotated[
    str, Option(metavar="URL", help="PostgreSQL that several services share; needs --store.", show_default=False)
]
ObjectStore = Annotated[
    str, Option(metavar="URL", help="Object store that they share, such as s3://bucket.", show_default=False)
]


def serve(
    host: Annotated[str, Option(help="Address to listen on; 0.0.0.0 is all of this machine's.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, metavar="PORT", help="0 takes a free one.")] = 8000,
    data: Data = None,
    token: Token = None,
    token_file: TokenFile = "",
    admin: Admin = None,
    quota: Annotated[list[str] | None, Option(metavar="NAME=NUMBER", help="A limit; --quota help lists them.")] = None,
    allow_host: Annotated[list[str] | None, Option(metavar="NAME", help="Another name of it; repeatable.")] = None,
    allow_origin: Annotated[list[str] | None, Option(metavar="URL", help="Site that may call it; repeatable.")] = None,
    trust_proxy: Proxy = None,
    log: Log = "text",
    delete_results: DeleteResults = False,
    dask: Annotated[str, Option(metavar="ADDRESS", help="Dask scheduler for sweeps.", show_default=False)] = "",
    database: Database = "",
    store: ObjectStore = "",
    root_path: Annotated[str, Option(metavar="PATH", help="The path below which it is.", show_default=False)] = "",
    settings: SettingsFile = None,  # noqa: ARG001  it has been read already
) -> None:
    """Serve queries, simulations and the page over HTTP.

    Without --host only this machine reaches it. Addresses always name it; --allow-host adds names. --allow-origin is a
    site whose pages may call it, such as https://lab.example. TWOLINK_TOKEN holds tokens too, with commas between;
    other users of this machine cannot read it. --token-file is read again when it changes. TWOLINK_DATABASE and
    TWOLINK_STORE stand for --database and --store, and TWOLINK_SERVE_NAME for --name of each option. --data is the
    folder of uploads, jobs and results.

    \b
    twolink serve                                       then open http://127.0.0.1:8000/
    curl -s 127.0.0.1:8000/v1/robots/two_link/forward-dynamics -d '{"q": [0, 0], "tau": [1, 0]}'
    TWOLINK_TOKEN=secret twolink serve --host 0.0.0.0   for others too; they send Authorization: Bearer secret
    twolink serve --quota jobs=4 --quota disk_mb=20000
    twolink serve --dask tcp://scheduler:8786           one service for a group with a cluster
    twolink serve --database postgresql://db/twolink --store s3://bucket    one of several; --data is its own

    The API is described at /docs and /openapi.json; `tl.connect("http://127.0.0.1:8000")` asks it from Python. Results
    survive a restart, and jobs that were not done are taken up by the next start. Ctrl-C ends the service.
    """
    from twolink.parts.service.settings import Quotas, Settings, is_loopback, read_quotas

    if quota and "help" in quota:
        for name, value in zip(Quotas.__struct_fields__, Quotas.__struct_defaults__, strict=True):
            typer.echo(f"{name}={value}")
        return
    of_environment = os.environ["TWOLINK_TOKEN"].split(",") if "TWOLINK_TOKEN" in os.environ else ()
    given = Settings(
        data=str(platformdirs.user_data_path("twolink", appauthor=False)) if data is None else data,
        host=host, port=port, root_path=root_path, log=log, delete_results=delete_results, dask=dask,
        tokens=tuple(text.strip() for text in (*(token or ()), *of_environment)), token_file=token_file,
        admins=tuple(admin or []), proxies=tuple(trust_proxy or []), quotas=read_quotas(quota or []),
        hosts=tuple(allow_host or []), origins=tuple(allow_origin or []),
        database=database or os.environ.get("TWOLINK_DATABASE", ""),
        store=store or os.environ.get("TWOLINK_STORE", ""),
    )  # fmt: skip
    if not is_loopback(host) and not (given.tokens or token_file):
        typer.echo(f"twolink: anybody who reaches {host} may use it; --token asks for one", err=True)
    server = import_extra("twolink.parts.service.http.server", "service")
    data_note = f"(data in {given.data}; Ctrl-C ends it)"
    server.run(given, on_start=lambda url: typer.echo(f"twolink serves {url}  {data_note}"))


def mcp(
    folder: Annotated[
        Path, Option(metavar="PATH", help="Where files are read and written.", show_default="this folder")
    ] = Path(),
) -> None:
    """Serve tools for agents over stdin and stdout (MCP).

    Tools: catalogue, load_robot, query, explain, simulate, accuracy_study, linearize, judge, call, export.
    They read and write in one folder only. Needs pip install 'twolink[mcp]'.

    \b
    {"mcpServers": {"twolink": {"command": "twolink", "args": ["mcp", "--folder", "robots"]}}}
    """
    require_extra("mcp", "mcp")
    from twolink.parts.service.agents import Tools

    Tools(folder).server().run("stdio")


COMMANDS = serve, mcp
