"""A client of the service: `tl.connect(url).robot("panda")` answers the queries of a Robot from another computer."""

import io
import json
import os
import time
import tomllib
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar
from urllib.parse import quote

import msgspec
import numpy as np

from twolink.errors import QueryError, RobotError, TwolinkError, require_extra
from twolink.io.text import decode
from twolink.parts.service.problems import JSON, Problem, error_from
from twolink.parts.service.remote_robot import RemoteRobot
from twolink.parts.service.transport import Transport
from twolink.robots.catalogue import open_source
from twolink.scenes import Scene, load_scene
from twolink.simulation.trajectory import Trajectory

T = TypeVar("T")
_POLL = 0.2  # seconds between looks at a job
_WAIT = 10.0  # seconds that the service waits for a job's end before it answers, at most


class _Job(msgspec.Struct):
    id: str
    state: str
    problem: Problem | None = None
    result: dict[str, Any] | None = None


class Client:
    """A connection to a service, for any number of threads. `connect` makes one.

    Parameters
    ----------
    url : str
        The address of the service, such as "http://127.0.0.1:8000".
    token : str, optional
        The bearer token, if the service asks for one.
    timeout : float
        Seconds that a request may take in all, with connecting, waiting for a busy service, and retries.

    Raises
    ------
    TwolinkError
        The address is none; later, the service does not answer. What the service refuses is raised as the error that
        the same call raises here, with its code, argument and data.
    """

    def __init__(self, url: str, token: str | None = None, timeout: float = 60.0) -> None:
        self._transport = Transport(url, token, timeout)
        self.url = self._transport.url

    def close(self) -> None:
        """Close the connections that are not in use. The next request opens another."""
        self._transport.close()

    def robots(self) -> list[dict[str, Any]]:
        """The robots of the service, those of its catalogue and those uploaded.

        Returns
        -------
        list of dict
            id, name and origin of each; nq, nv, mass [kg] and root of those uploaded.
        """
        found: list[dict[str, Any]] = []
        path = "/v1/robots"
        while True:
            page = self._json("GET", path, None, list[dict[str, Any]])
            uploaded = [one for one in page if one.get("origin") == "uploaded"]
            found += uploaded if found else page
            if not uploaded:
                return found
            path = f"/v1/robots?before={uploaded[-1]['created']!r}"

    def robot(self, name: str) -> RemoteRobot:
        """A robot of the service.

        Parameters
        ----------
        name : str
            Its name in the catalogue, or the id of an upload.

        Raises
        ------
        TwolinkError
            Code "not-found"; the remedy has the nearest name.
        """
        return RemoteRobot(
            self._transport, self._json("GET", f"/v1/robots/{quote(name, safe='')}", None, dict[str, Any])
        )

    def upload(self, urdf: str | os.PathLike[str], **options: Any) -> RemoteRobot:
        """Upload a robot.

        Parameters
        ----------
        urdf : str or path
            The text of a URDF, or a path; its meshes are not sent.
        **options
            As of `tl.load_robot`: root, lock, gravity, mimic, unphysical, foreign.

        Raises
        ------
        RobotError
            The URDF is refused.
        """
        if "<" not in os.fspath(urdf):
            urdf = decode(open_source(urdf).data, Path(urdf), RobotError)
        body = {"text": urdf, **options}
        return RemoteRobot(self._transport, self._json("POST", "/v1/robots", body, dict[str, Any]))

    def simulate(
        self, scene: str | Scene, duration: float | None = None, *, accuracy: float | None = None, **options: Any
    ) -> Trajectory:
        """As `tl.simulate`, computed by the service; waits for the end.

        Parameters
        ----------
        scene : str or Scene
            A scene, or what `tl.load_scene` takes. A robot that is not of the catalogue is uploaded.
        duration : float, optional
            Simulated seconds; the scene's own when left out.
        accuracy : float, optional
            Bound of the global error, rad or m; as of `tl.simulate`.
        **options
            t_eval, samples_per_second, method, verify, precision, tolerance, step, contact, as of `tl.simulate`.

        Raises
        ------
        SceneError, AccuracyError
            As of `tl.simulate`, without the run.
        """
        local = scene if isinstance(scene, Scene) else load_scene(scene)
        path, _ = self._job("/v1/simulations", self._body(local, duration, accuracy=accuracy, **options))
        with TemporaryDirectory() as folder:
            file = Path(folder) / "result.npz"
            file.write_bytes(self.request("GET", f"{path}/result?format=npz")[1])
            return Trajectory.load(file, local.robot)

    def linearize(self, scene: str | Scene, **state: Any) -> dict[str, Any]:
        """As `tl.linearize`: A, B, names, eigenvalues and more, as the service answers them. state: q, v."""
        return self._json("POST", "/v1/scenes/linearize", self._body(scene, **state), dict[str, Any])

    def sensitivities(
        self, scene: str | Scene, duration: float | None = None, *, wrt: Sequence[str] = ("q", "v"), **options: Any
    ) -> dict[str, Any]:
        """As `tl.sensitivities`: t, the run's record, and by name q (n, nv, k), v and error, as lists.

        options: accuracy, t_eval, samples_per_second.
        """
        return self._job("/v1/sensitivities", self._body(scene, duration, wrt=list(wrt), **options))[1]

    def identify(self, robot: str, data: str, **options: Any) -> dict[str, Any]:
        """As `twolink identify --json`. robot: an id. data: the text of a CSV file.

        options: parameters, method, confidence.
        """
        return self._job("/v1/identifications", {"robot": robot, "data": data, **options})[1]

    def sweep(
        self, scene: str | Scene, duration: float | None = None, *, vary: Mapping[str, Any],
        out: str | os.PathLike[str], **options: Any,
    ) -> Any:  # fmt: skip
        """As `tl.sweep`, computed by the service; its results in a new store here.

        Parameters
        ----------
        scene : str or Scene
            As of `simulate`.
        duration : float, optional
            As of `simulate`.
        vary : mapping
            As of `tl.sweep`.
        out : path-like
            The store, a folder that does not exist yet.
        **options
            accuracy, t_eval, samples_per_second, design, count, seed, outputs (without functions), verify.

        Returns
        -------
        xarray.Dataset
            Asked for again, the service answers from its own store, and goes on where it was stopped.

        Raises
        ------
        TwolinkError
            Of `tl.sweep`; code "file-exists" where the folder exists.
        """
        target = Path(out)
        if target.exists():
            raise TwolinkError("it exists", where=str(target), code="file-exists", remedy="give a new path")
        require_extra("zarr", "sweeps")  # before anything is computed
        from twolink.parts.sweeps.sweeping import open_sweep

        path, _ = self._job("/v1/sweeps", self._body(scene, duration, vary=dict(vary), **options))
        content = self.request("GET", f"{path}/result?format=zip")[1]
        with TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.") as folder:
            zipfile.ZipFile(io.BytesIO(content)).extractall(Path(folder) / "store")
            (Path(folder) / "store").rename(target)
        return open_sweep(target)

    def call(self, function: str, **arguments: Any) -> dict[str, Any]:
        """Another function of the package, computed by the service.

        Parameters
        ----------
        function : str
            Its name in `twolink`: compare_models, energy_book, equilibria, fit, gradient, judge, lqr, optimize,
            periodic_motion, simulate_many, step_table or trapezoidal_motion.
        **arguments
            Its own, all by name. A scene is one, or a bundled one's name; a robot one of this service, or its id;
            measurements and trajectories are arrays by name.

        Returns
        -------
        dict
            The result's `to_dict()`, with a title and its text.

        Raises
        ------
        TwolinkError
            As of the function; what is not sent, such as functions and paths, is refused by name.
        """
        sent = {name: self._content(value) if isinstance(value, Scene) else getattr(value, "id", value)
                for name, value in arguments.items()}  # fmt: skip
        return self._job("/v1/operations", {"operation": function, **sent})[1]

    def _job(self, path: str, body: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """Wait for the end of a job. Returns its path and its result. Raises what it ended with."""
        body.setdefault("wait", min(_WAIT, self._transport.timeout / 2))
        job = self._json("POST", path, body, _Job)
        path = f"{path}/{quote(job.id, safe='')}"
        while job.state in ("queued", "running"):
            time.sleep(_POLL)
            job = self._json("GET", path, None, _Job)
        if job.problem:
            raise error_from(job.problem)
        if job.state != "done":
            raise TwolinkError(f"the job was {job.state}", where=self.url, code=job.state)
        return path, job.result or {}

    def _body(self, scene: str | Scene, duration: float | None = None, **fields: Any) -> dict[str, Any]:
        """The body of a request about a scene."""
        local = scene if isinstance(scene, Scene) else load_scene(scene)
        given = {} if duration is None else {"duration": duration}
        return {"scene": self._content(local), **given, **fields}

    def _content(self, scene: Scene) -> dict[str, Any]:
        """A scene as the service takes it, its robot uploaded unless it is of the catalogue."""
        with TemporaryDirectory() as folder:
            file = scene.save(Path(folder) / "scene.toml")
            content: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
            robot = content["robot"] if isinstance(content["robot"], dict) else {"source": content["robot"]}
            urdf = Path(folder) / robot["source"]
            if urdf.is_file():
                options = {key: robot[key] for key in ("root", "lock") if key in robot}
                content["robot"] = self.upload(urdf, **options).id
        return content

    def _json(self, method: str, path: str, body: Any, kind: type[T]) -> T:
        """The answer to a request of the API, all of which may be sent twice."""
        content = None if body is None else _encoded(body)
        media, answer = self._transport.request(method, path, content, JSON, JSON, repeatable=True)
        try:
            return msgspec.json.decode(answer if media == JSON else b"", type=kind)
        except msgspec.MsgspecError as error:
            raise self._transport.not_twolink(path, f"it is {media}" if media != JSON else str(error)) from None

    def request(
        self, method: str, path: str, body: bytes | None = None, media: str = JSON, accept: str = "*/*"
    ) -> tuple[str, bytes]:
        """Any request of the API.

        Parameters
        ----------
        method, path : str
            Such as "GET" and "/v1/robots".
        body : bytes, optional
        media, accept : str
            The media types of the body, and of the answer.

        Returns
        -------
        media : str
            The media type of the answer.
        content : bytes

        Raises
        ------
        TwolinkError
            The service does not answer, or refuses.
        """
        return self._transport.request(method, path, body, media, accept)

    def __repr__(self) -> str:
        return f"<Client of {self.url}>"


def connect(url: str, token: str | None = None, timeout: float = 60.0) -> Client:
    """Connect to a service that `twolink serve` has started.

    Parameters
    ----------
    url : str
        Its address, such as "http://127.0.0.1:8000".
    token : str, optional
        A bearer token, if the service asks for one.
    timeout : float
        Seconds that a request may take in all. A simulation, or a batch in parts, takes several requests.

    Returns
    -------
    Client
        The first request opens a connection.

    Raises
    ------
    TwolinkError
        The address is none.
    """
    return Client(url, token, timeout)


def _encoded(body: Any) -> bytes:
    """JSON. Raises QueryError for what JSON has not; msgspec would write null for nan."""
    try:
        return json.dumps(body, allow_nan=False, default=_plain).encode()
    except (TypeError, ValueError) as error:
        raise QueryError(f"cannot be sent: {error}", where="request", remedy="give finite numbers and texts") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r:.60} is no number and no text")
