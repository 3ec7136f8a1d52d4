"""A client of the service: `tl.connect(url).robot("panda")` answers the queries of a Robot from far away."""

from __future__ import annotations

import http.client
import io
import time
import tomllib
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote, urlsplit

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.errors import QueryError, TwolinkError
from twolink.scenes import Scene, load_scene
from twolink.service import npz
from twolink.service.problems import Problem, error_from
from twolink.simulation.trajectory import Trajectory

JSON = "application/json"
Array = np.ndarray[Any, np.dtype[np.float64]]
_POLL = 0.2  # seconds between looks at a job


class Client:
    """A connection to a service at `url`. token: its bearer token, if it asks for one. timeout: seconds for an answer.

    May be used from many threads. What the service refuses is raised as the
    TwolinkError it would be here; TwolinkError too when the service cannot be reached.
    """

    def __init__(self, url: str, token: str | None = None, timeout: float = 60.0) -> None:
        parts = urlsplit(url if "://" in url else f"http://{url}")
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise TwolinkError(f"{url!r} is not an address", where="connect", remedy="such as http://127.0.0.1:8000")
        self.url = f"{parts.scheme}://{parts.netloc}{parts.path.rstrip('/')}"
        self._parts, self._token, self._timeout = parts, token, timeout
        self._idle: deque[http.client.HTTPConnection] = deque()

    def close(self) -> None:
        """Close the connections that are not in use; asking again opens others."""
        while self._idle:
            self._idle.pop().close()

    def robots(self) -> list[dict[str, Any]]:
        """The robots of the service, those of its catalogue and those uploaded."""
        found: list[dict[str, Any]] = self._json("GET", "/v1/robots")
        return found

    def robot(self, name: str) -> RemoteRobot:
        """A robot by its name in the catalogue, or by the id of an upload."""
        return RemoteRobot(self, self._json("GET", f"/v1/robots/{quote(name, safe='')}"))

    def upload(self, urdf: str, **options: Any) -> RemoteRobot:
        """A robot from the text of a URDF; options as of `tl.load_robot`: root, lock, gravity, mimic, unphysical."""
        return RemoteRobot(self, self._json("POST", "/v1/robots", {"text": urdf, **options}))

    def simulate(
        self, scene: str | Scene, duration: float | None = None, accuracy: float = 1e-6, **options: Any
    ) -> Trajectory:
        """As `tl.simulate`, computed by the service; waits for the end. options: method, samples, verify, ..."""
        local = load_scene(scene) if isinstance(scene, str) else scene
        asked = {"scene": self._content(local), "accuracy": accuracy, "wait": 10, **options}
        job = self._json("POST", "/v1/simulations", asked if duration is None else {**asked, "duration": duration})
        path = f"/v1/simulations/{job['id']}"
        while job["state"] in ("queued", "running"):
            time.sleep(_POLL)
            job = self._json("GET", path)
        if job["state"] != "done":
            if job["problem"]:
                raise error_from(msgspec.convert(job["problem"], Problem))
            raise TwolinkError(
                f"the simulation was {job['state']}", where=self.url, remedy="ask again", code=job["state"]
            )
        with TemporaryDirectory() as folder:
            file = Path(folder) / "result.npz"
            file.write_bytes(self.request("GET", f"{path}/result?format=npz")[1])
            return Trajectory.load(file, local.robot)

    def _content(self, scene: Scene) -> dict[str, Any]:
        """A scene as the service takes it; a robot of no catalogue is uploaded."""
        with TemporaryDirectory() as folder:
            file = scene.save(Path(folder) / "scene.toml")
            content: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
            robot = content["robot"] if isinstance(content["robot"], dict) else {"source": content["robot"]}
            urdf = Path(folder) / robot["source"]
            if urdf.is_file():
                options = {key: robot[key] for key in ("root", "lock") if key in robot}
                content["robot"] = self.upload(urdf.read_text(encoding="utf-8"), **options).id
        return content

    def _json(self, method: str, path: str, body: Any = None) -> Any:
        content = None if body is None else msgspec.json.encode(body)
        return msgspec.json.decode(self.request(method, path, content)[1])

    def request(
        self, method: str, path: str, body: bytes | None = None, media: str = JSON, accept: str = "*/*"
    ) -> tuple[str, bytes]:
        """The media type and the body of an answer; what is no success is raised."""
        headers = {"Accept": accept, **({} if body is None else {"Content-Type": media})}
        if self._token:
            headers["Authorization"] = f"Bearer {self._token}"
        try:
            status, kind, content = self._exchange(method, self._parts.path.rstrip("/") + path, body, headers)
        except (OSError, http.client.HTTPException) as error:
            what = f"no answer: {getattr(error, 'strerror', None) or error or type(error).__name__}"
            raise TwolinkError(what, where=self.url, remedy="is it running? `twolink serve` starts one") from None
        if 200 <= status < 300:
            return kind, content
        raise error_from(_problem(status, content))

    def _exchange(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str]
    ) -> tuple[int, str, bytes]:
        """One request, on a connection that is open already if there is one."""
        while True:
            try:
                connection, used = self._idle.pop(), True
            except IndexError:
                connection, used = self._connection(), False
            try:
                connection.request(method, path, body, dict(headers))
                answer = connection.getresponse()
                result = answer.status, answer.headers.get_content_type(), answer.read()
            except (OSError, http.client.HTTPException):
                connection.close()
                if not used:  # else the service may have closed it meanwhile
                    raise
                continue
            self._idle.append(connection)
            return result

    def _connection(self) -> http.client.HTTPConnection:
        kind = http.client.HTTPSConnection if self._parts.scheme == "https" else http.client.HTTPConnection
        return kind(self._parts.hostname or "", self._parts.port, timeout=self._timeout)

    def __repr__(self) -> str:
        return f"<Client of {self.url}>"


class RemoteRobot:
    """A robot of a service, with the queries of Robot: the same arguments, shapes and errors.

    Single states go as JSON, batches as arrays. name, nq, nv, mass, joint_names, neutral, report (as plain data): as of
    Robot. id: what the service calls it. description: all that it says of it.
    """

    def __init__(self, client: Client, description: dict[str, Any]) -> None:
        self.description = description
        self.id: str = description["id"]
        self.name: str = description["name"]
        self.nq: int = description["nq"]
        self.nv: int = description["nv"]
        self.mass: float = description["mass"]
        self.report: dict[str, Any] = description["report"]
        self.joint_names: tuple[str, ...] = tuple(joint["name"] for joint in description["joints"])
        self._client = client

    @property
    def neutral(self) -> Array:
        """The neutral configuration (nq,)."""
        return np.array(self.description["neutral"])

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, f_ext: Mapping[str, ArrayLike] | None = None,
        method: str = "aba",
    ) -> Array:  # fmt: skip
        """Accelerations (..., nv). f_ext: wrenches (..., 6) by frame name, along the frame's own axes."""
        extra = {} if method == "aba" else {"method": method}
        return self._ask("forward-dynamics", {"q": q, "v": v, "tau": tau}, f_ext, extra)["a"]

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: Mapping[str, ArrayLike] | None = None
    ) -> Array:
        """Torques (..., nv)."""
        return self._ask("inverse-dynamics", {"q": q, "v": v, "a": a}, f_ext)["tau"]

    def mass_matrix(self, q: ArrayLike) -> Array:
        """The joint-space inertia matrix (..., nv, nv)."""
        return self._ask("mass-matrix", {"q": q})["M"]

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The torques that keep all accelerations zero (..., nv)."""
        return self._ask("bias", {"q": q, "v": v})["h"]

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """A Coriolis matrix (..., nv, nv)."""
        return self._ask("coriolis", {"q": q, "v": v})["C"]

    def gravity_torque(self, q: ArrayLike) -> Array:
        """The torques that hold the robot still (..., nv)."""
        return self._ask("gravity-torque", {"q": q})["g"]

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """(kinetic, potential), (...,) each, J."""
        answer = self._ask("energy", {"q": q, "v": v})
        return answer["kinetic"], answer["potential"]

    def link_poses(self, q: ArrayLike) -> dict[str, Array]:
        """Where the links are: position [m] and quaternion (x y z w), (..., 7) each, by name."""
        poses = self._ask("kinematics", {"q": q})["poses"]
        return {name: poses[..., i, :] for i, name in enumerate(self.description["links"])}

    def _ask(
        self, what: str, arguments: Mapping[str, ArrayLike], f_ext: Mapping[str, ArrayLike] | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> dict[str, Array]:  # fmt: skip
        arrays = {name: _array(name, value) for name, value in arguments.items()}
        wrenches = {frame: _array(f"f_ext[{frame!r}]", value) for frame, value in (f_ext or {}).items()}
        path = f"/v1/robots/{quote(self.id, safe='')}/{what}"
        if extra or all(array.ndim == 1 for array in (*arrays.values(), *wrenches.values())):
            plain: dict[str, Any] = {name: array.tolist() for name, array in arrays.items()}
            if wrenches:
                plain["f_ext"] = {frame: array.tolist() for frame, array in wrenches.items()}
            answer = self._client._json("POST", path, {**plain, **(extra or {})})
            return {name: np.array(value) for name, value in answer.items() if name != "frames"}
        named = {f"f_ext.{frame}": array for frame, array in wrenches.items()}
        body = npz.write_npz({**arrays, **named})
        with np.load(io.BytesIO(self._client.request("POST", path, body, npz.MEDIA_TYPE)[1])) as found:
            return {name: found[name] for name in found.files if name != "frames"}

    def __repr__(self) -> str:
        return f"<RemoteRobot {self.name!r}: nq={self.nq}, nv={self.nv}, {self.mass:.4g} kg, at {self._client.url}>"


def connect(url: str, token: str | None = None, timeout: float = 60.0) -> Client:
    """A client of the service at `url`, such as "http://127.0.0.1:8000". token: if the service asks for one."""
    return Client(url, token, timeout)


def _array(name: str, value: Any) -> np.ndarray:
    """An argument as floats. Raises QueryError; what else is wrong with it, the service says."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise QueryError("expected an array of numbers", where=name, remedy="give shape (..., n)") from None


def _problem(status: int, content: bytes) -> Problem:
    try:
        return msgspec.json.decode(content, type=Problem)
    except msgspec.MsgspecError:  # another server answered, such as a proxy
        remedy = "check that the address is that of a twolink service"
        return Problem("", "", status, f"HTTP status {status}", remedy=remedy, code="not-twolink")
