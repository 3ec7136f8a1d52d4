"""Tools for agents by the Model Context Protocol (MCP): what the package answers, as data with error bars.

A tool reads names and files in one folder, and writes there alone. A refusal is data too: code, what, where, remedy.
"""

import functools
import hashlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import anyio.from_thread
import anyio.lowlevel
import msgspec
from mcp.server.mcpserver import Context, MCPServer
from mcp.types import CallToolResult, TextContent, ToolAnnotations
from pydantic import Field

import twolink as tl
from twolink._version import __version__
from twolink.cli.common import scene_from, write_by_ending
from twolink.dynamics.queries import QUERIES, Numbers, answer_query
from twolink.dynamics.robot_record import robot_record
from twolink.errors import QueryError, TwolinkError, require_known
from twolink.io.docstrings import texts_of
from twolink.io.files import confined, write_atomic
from twolink.io.progress import Report
from twolink.io.schemas import misfit
from twolink.parts.service.work.requests import OPERATIONS, operation_requests
from twolink.parts.service.work.scene_tasks import answer_of_call
from twolink.robots.catalogue import FILES, catalogue_folders, catalogue_names
from twolink.scenes import bundled_scenes
from twolink.scenes.urdf_scene import UrdfScene
from twolink.simulation.text import as_data

LARGEST = 20_000  # letters of an answer; more go to a file
PATIENCE = 120.0  # s of computing
SHOWN = 20  # events
READS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
WRITES = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=False)
INSTRUCTIONS = """Rigid-body dynamics with error bars. A robot is a name of `catalogue`, a URDF or MJCF in the folder,
or its text. A scene is a name, a .toml file in the folder, or a robot: then with all that its file says. SI units and
radians. `error` bounds the global error where `bound` is "verified". A refusal has a code and a remedy."""
What = Annotated[str, Field(json_schema_extra={"enum": list(QUERIES)})]
Function = Annotated[str, Field(json_schema_extra={"enum": list(OPERATIONS)})]
Root = Literal["fixed", "free"]


@dataclass
class Answer:
    """text: for people. data: the same for programs. error: how far q may be off, rad or m; what that is says bound:
    verified, estimated, or nothing. files: what was written."""

    text: str
    data: dict[str, Any]
    error: float | None = None
    bound: Literal["verified", "estimated", ""] = ""
    files: list[str] = field(default_factory=list)


class Tools:
    """The tools, one at a time. folder: where files are read and written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self._one = threading.Lock()  # Pinocchio's data belong to one thread
        self._robots = functools.lru_cache(16)(tl.load_robot)

    def server(self) -> MCPServer:
        """The server with all tools."""
        made = MCPServer("twolink", version=__version__, instructions=INSTRUCTIONS)
        readers = (self.catalogue, self.load_robot, self.query, self.explain, self.accuracy_study, self.linearize,
                   self.judge, self.call)  # fmt: skip
        for tool in (*readers, self.simulate, self.export):
            made.tool(annotations=READS if tool in readers else WRITES)(self._guarded(tool))
        return made

    def catalogue(self) -> Answer:
        """The robots and scenes known by name, and all queries and functions with their arguments and units."""
        table = {row["name"]: row["title"] for row in tl.scenes()}
        queries = [query.to_dict() for query in QUERIES.values()]
        functions = {name: texts_of(getattr(tl, name)) for name in OPERATIONS}
        data = {"robots": list(catalogue_names()), "scenes": table, "queries": queries, "functions": functions}
        text = ", ".join(f"{len(known)} {what}" for what, known in data.items())
        return Answer(text, data)

    def load_robot(self, robot: str, root: Root = "fixed") -> Answer:
        """A robot's joints with their limits, links, mass, and the report of what was read, ignored and assumed."""
        loaded = self._robot(robot, root)
        return Answer(str(loaded.report), robot_record(loaded))

    def query(
        self, robot: str, what: What, arguments: dict[str, Numbers], options: dict[str, Any] | None = None,
        root: Root = "fixed",
    ) -> Answer:  # fmt: skip
        """A dynamics query for a state or a batch, such as forward-dynamics with {"q": [0, 0], "tau": [1, 0]}.

        `catalogue` declares the queries. Arguments that are left out are zero, but q. Answers are Pinocchio's, in
        double precision.
        """
        found = answer_query(self._robot(robot, root), what, arguments, **(options or {}))
        units = {name: unit for name, (_, unit) in QUERIES[what].results.items()}
        return Answer(f"{what}: {', '.join(found)}", {"results": as_data(found), "units": units})

    def explain(self, scene: str, duration: float | None = None, accuracy: float = 1e-6) -> Answer:
        """Explain what a scene computes, what each effect costs, and how it would be solved; nothing is simulated."""
        explained = tl.explain(self._scene(scene), duration, accuracy=accuracy)
        return Answer(str(explained), as_data(explained))

    def simulate(
        self, scene: str, context: Context, duration: float | None = None, accuracy: float | None = None,
        at: list[float] | None = None, save: list[str] | None = None,
    ) -> Answer:  # fmt: skip
        """Simulate a scene, with a bound on the global error of q: 1e-6 unless given, or the best of a stepped scene.

        The answer has the end, events and cost. at: times, s, whose states it has too. save: files for the samples
        (.csv .npz .parquet .mcap ...), a figure (.png) or a playback (.html).
        """
        targets = [self._path(name) for name in save or []]
        run = tl.simulate(
            self._scene(scene), duration, accuracy=accuracy, patience=PATIENCE, progress=_progress(context)
        )
        data = run.to_dict()
        data |= {"events": data["events"][:SHOWN], "events_in_all": len(data["events"])}
        if at is not None:
            q, v = run.at(at)
            data["states"] = [as_data({"t": t, "q": a, "v": b}) for t, a, b in zip(at, q, v, strict=True)]
        for path in targets:
            write_by_ending(run, path)
        error = None if run.error is None else float(run.error.max())
        return Answer(repr(run), data, error, run.bound, [str(path) for path in targets])

    def accuracy_study(self, scene: str, context: Context, duration: float | None = None) -> Answer:
        """Measure the cost of each digit: the error and the time of the methods at several tolerances."""
        study = tl.accuracy_study(self._scene(scene), duration, budget=0.2, repeats=3, progress=_progress(context))
        return Answer(str(study), study.to_dict())

    def linearize(self, scene: str, q: list[float] | None = None, v: list[float] | None = None) -> Answer:
        """The linear equations of small motions around a state, the scene's own where it is left out."""
        found = tl.linearize(self._scene(scene), q, v)
        return Answer(str(found), found.to_dict())

    def judge(
        self, scene: str, log: str, tolerance: float = 1e-6, start: Literal["scene", "log"] | None = None
    ) -> Answer:
        """Judge a simulator's log by the solution of a scene: right, wrong or not known; how far off, since when, why.

        log: a file (.csv .npz .parquet: t, q.JOINT, v.JOINT; .mcap .db3: joint states). start: where the solution
        starts, by default at the scene's state, and of a robot at the log's first sample.
        """
        asked = self._scene(scene)
        begin = start or ("log" if isinstance(asked, UrdfScene) else "scene")
        verdict = tl.judge(asked, self._path(log), start=begin, tolerance=tolerance)
        data = {name: value for name, value in verdict.to_dict().items() if name not in ("t", "distance", "bar")}
        data |= {"farthest": float(verdict.distance.max())}
        return Answer(str(verdict), data, float(verdict.bar.max()), verdict.bound)

    def call(self, function: Function, arguments: dict[str, Any]) -> Answer:
        """Call another function, such as equilibria with {"scene": "arm-swing", "starts": 8}.

        `catalogue` has the functions with their arguments. Scenes and robots are given as in the other tools.
        """
        require_known(function, OPERATIONS, QueryError, argument="function")
        try:
            request = msgspec.convert({"operation": function, **arguments}, kind := operation_requests()[function])
        except msgspec.ValidationError as error:
            what, where, remedy = misfit(error, kind)
            raise QueryError(what, argument=where or "arguments",
                             remedy=remedy or "`catalogue` has its arguments") from None  # fmt: skip
        data = answer_of_call(request, self._scene, lambda name: self._robot(name, "fixed"), patience=PATIENCE)
        return Answer(data.pop("text"), data)

    def export(self, robot: str, file: str, functions: list[str] | None = None, root: Root = "fixed") -> Answer:
        """Write a robot as .urdf, .xml (MJCF) or .c. functions: of C, such as ["forward_dynamics", "step:rk4"]."""
        loaded, path = self._robot(robot, root), self._path(file)
        of_c = path.suffix.lower() == ".c"
        if functions and not of_c:
            raise QueryError("functions are written as .c", argument="functions", remedy="leave it out, or name a .c")
        written = [tl.export(loaded, path, **({"functions": functions or ["forward_dynamics"]} if of_c else {}))]
        written += [path.with_suffix(".h")] if of_c else []
        return Answer(f"wrote {', '.join(map(str, written))}", {}, files=[str(path) for path in written])

    def _guarded(self, tool: Callable[..., Answer]) -> Callable[..., Any]:
        """The tool, whose refusals are data, and whose answers are not longer than LARGEST."""

        @functools.wraps(tool)
        def call(**given: Any) -> Any:
            try:
                with self._one:
                    return self._bounded(tool(**given), tool.__name__)
            except TwolinkError as error:
                data = {name: getattr(error, name) for name in ("code", "what", "where", "remedy", "argument", "data")}
                text = TextContent(type="text", text=str(error)[:LARGEST])
                return CallToolResult(content=[text], structured_content=_cut(as_data(data)), is_error=True)

        return call

    def _bounded(self, answer: Answer, tool: str) -> Answer:
        whole = json.dumps({"text": answer.text, "data": answer.data}, allow_nan=False, default=as_data)
        if len(whole) > LARGEST:
            name = f"{tool}-{hashlib.sha256(whole.encode()).hexdigest()[:12]}.json"
            path = write_atomic(self.folder / name, lambda file: file.write(whole.encode()))
            answer.data, answer.files = {"left_out": f"{len(whole)} letters: see {name}"}, [*answer.files, str(path)]
        answer.text = _cut(answer.text)
        return answer

    def _robot(self, source: str, root: Root) -> tl.Robot:
        kept = source in catalogue_names() or "<" in source  # what a file holds may be another robot next time
        with confined(self.folder, *catalogue_folders()):
            return self._robots(source, root=root) if kept else tl.load_robot(self._path(source), root=root)

    def _scene(self, source: Any) -> tl.Scene:
        if not isinstance(source, str):
            raise QueryError("expected a name, or a file", argument="scene", remedy="write a scene into a .toml file")
        named = source in bundled_scenes() or source in catalogue_names()
        given = source if named else str(self._path(source, (*FILES, ".toml")))
        with confined(self.folder, *catalogue_folders()):
            return scene_from(given)

    def _path(self, name: str, endings: tuple[str, ...] = ()) -> Path:
        """A path in the folder. Raises TwolinkError (code "not-allowed")."""
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder):
            raise TwolinkError("it is outside the folder of this server", where=name, code="not-allowed",
                               remedy=f"give a path in {self.folder}")  # fmt: skip
        if endings and path.suffix.lower() not in endings:
            raise TwolinkError("it is neither a name of the catalogue nor a .toml, .urdf or .xml", where=name[:80],
                               code="not-allowed", remedy="`catalogue` lists names")  # fmt: skip
        return path


def _cut(value: Any) -> Any:
    """A text, or the texts in data, no longer than half of LARGEST."""
    if isinstance(value, dict):
        return {name: _cut(one) for name, one in value.items()}
    return f"{value[: LARGEST // 2]} ..." if isinstance(value, str) and len(value) > LARGEST // 2 else value


def _progress(context: Context) -> Report:
    """The callback that tells the client the progress of a call, at most five times a second."""
    token, told = anyio.from_thread.run_sync(anyio.lowlevel.current_token), [0.0]

    def report(done: float, total: float, label: str = "") -> None:
        if time.monotonic() - told[0] > 0.2:
            told[0] = time.monotonic()
            anyio.from_thread.run(context.report_progress, done, total, label, token=token)

    return report
