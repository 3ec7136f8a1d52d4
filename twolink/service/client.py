"""A client of the service: `tl.connect(url).robot("panda")` answers the queries of a Robot from another computer."""

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
Wrenches = Mapping[str, ArrayLike]
_POLL = 0.2  # seconds between looks at a job


class Client:
    """A connection to a service, for any number of threads. `connect` makes one.

    Parameters
    ----------
    url : str
        The address of the service, such as "http://127.0.0.1:8000".
    token : str, optional
        The bearer token, if the service asks for one.
    timeout : float
        Seconds to wait for an answer.

    Raises
    ------
    TwolinkError
        The address is none; later, the service does not answer. What the service refuses is raised as the error that
        the same call raises here, with its code, argument and data.
    """

    def __init__(self, url: str, token: str | None = None, timeout: float = 60.0) -> None:
        parts = urlsplit(url if "://" in url else f"http://{url}")
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise TwolinkError(f"{url!r} is not an address", argument="url", remedy="such as http://127.0.0.1:8000")
        self.url = f"{parts.scheme}://{parts.netloc}{parts.path.rstrip('/')}"
        self._parts, self._timeout = parts, timeout
        self._authorization = {"Authorization": f"Bearer {token}"} if token else {}
        self._idle: deque[http.client.HTTPConnection] = deque()

    def close(self) -> None:
        """Close the connections that are not in use. The next request opens another."""
        while self._idle:
            self._idle.pop().close()

    def robots(self) -> list[dict[str, Any]]:
        """The robots of the service, those of its catalogue and those uploaded.

        Returns
        -------
        list of dict
            id, name and origin of each; nq, nv, mass [kg] and root of those uploaded.
        """
        listed: list[dict[str, Any]] = self._json("GET", "/v1/robots")
        return listed

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
        return RemoteRobot(self, self._json("GET", f"/v1/robots/{quote(name, safe='')}"))

    def upload(self, urdf: str, **options: Any) -> RemoteRobot:
        """Upload a robot.

        Parameters
        ----------
        urdf : str
            The text of a URDF.
        **options
            As of `tl.load_robot`: root, lock, gravity, mimic, unphysical.

        Raises
        ------
        RobotError
            The URDF is refused.
        """
        return RemoteRobot(self, self._json("POST", "/v1/robots", {"text": urdf, **options}))

    def simulate(
        self, scene: str | Scene, duration: float | None = None, accuracy: float = 1e-6, **options: Any
    ) -> Trajectory:
        """As `tl.simulate`, computed by the service; waits for the end.

        Parameters
        ----------
        scene : str or Scene
            A scene, or what `tl.load_scene` takes. A robot that is not of the catalogue is uploaded.
        duration : float, optional
            Simulated seconds; the scene's own when left out.
        accuracy : float
            Bound of the global error, rad or m.
        **options
            method, samples, verify, precision, tolerance, step, as of `tl.simulate`.

        Raises
        ------
        SceneError, AccuracyError
            As of `tl.simulate`, without the run.
        """
        local = load_scene(scene) if isinstance(scene, str) else scene
        body = {"scene": self._content(local), "accuracy": accuracy, "wait": 10, **options}
        job = self._json("POST", "/v1/simulations", body if duration is None else {**body, "duration": duration})
        path = f"/v1/simulations/{job['id']}"
        while job["state"] in ("queued", "running"):
            time.sleep(_POLL)
            job = self._json("GET", path)
        if job["problem"]:
            raise error_from(msgspec.convert(job["problem"], Problem))
        if job["state"] != "done":
            raise TwolinkError(f"the simulation was {job['state']}", where=self.url, code=job["state"])
        with TemporaryDirectory() as folder:
            file = Path(folder) / "result.npz"
            file.write_bytes(self.request("GET", f"{path}/result?format=npz")[1])
            return Trajectory.load(file, local.robot)

    def _content(self, scene: Scene) -> dict[str, Any]:
        """A scene as the service takes it, its robot uploaded unless it is of the catalogue."""
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
        headers = {"Accept": accept, "Content-Type": media, **self._authorization}
        try:
            status, kind, content = self._exchange(method, self._parts.path.rstrip("/") + path, body, headers)
        except (OSError, http.client.HTTPException) as error:
            what = f"no answer: {getattr(error, 'strerror', None) or error or type(error).__name__}"
            remedy = "is it running? `twolink serve` starts one"
            raise TwolinkError(what, where=self.url, code="no-answer", remedy=remedy) from None
        if 200 <= status < 300:
            return kind, content
        raise error_from(_problem(status, content))

    def _exchange(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str]
    ) -> tuple[int, str, bytes]:
        """One request, on an open connection if there is one."""
        kind = http.client.HTTPSConnection if self._parts.scheme == "https" else http.client.HTTPConnection
        try:
            connection = self._idle.pop()
        except IndexError:
            connection = kind(self._parts.hostname or "", self._parts.port, timeout=self._timeout)
        for is_last in (connection.sock is None, True):
            try:
                connection.request(method, path, body, dict(headers))
                answer = connection.getresponse()
                result = answer.status, answer.headers.get_content_type(), answer.read()
                break
            except (OSError, http.client.HTTPException) as error:
                connection.close()  # the next request opens it again
                if is_last or isinstance(error, TimeoutError):  # else the service may have closed it meanwhile
                    raise
        self._idle.append(connection)
        return result

    def __repr__(self) -> str:
        return f"<Client of {self.url}>"


class RemoteRobot:
    """A robot of a service, with the queries of Robot: the same arguments, shapes, units and errors.

    Single states go as JSON, batches as arrays.

    Attributes
    ----------
    id : str
        What the service calls the robot.
    name, nq, nv, mass, joint_names, neutral, report
        As of Robot; the report as plain data.
    description : dict
        All that the service says of the robot.
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
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, f_ext: Wrenches | None = None, method: str = "aba"
    ) -> Array:
        """Accelerations a (..., nv), M(q) a + h(q, v) = tau. f_ext: wrenches (..., 6) by frame, along its axes."""
        texts = {} if method == "aba" else {"method": method}
        return self._ask("forward-dynamics", f_ext, texts, q=q, v=v, tau=tau)[0]

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: Wrenches | None = None) -> Array:
        """Torques (..., nv)."""
        return self._ask("inverse-dynamics", f_ext, q=q, v=v, a=a)[0]

    def mass_matrix(self, q: ArrayLike) -> Array:
        """The joint-space inertia matrix M (..., nv, nv)."""
        return self._ask("mass-matrix", q=q)[0]

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The torques h(q, v) (..., nv) that keep all accelerations zero."""
        return self._ask("bias", q=q, v=v)[0]

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """A Coriolis matrix C (..., nv, nv)."""
        return self._ask("coriolis", q=q, v=v)[0]

    def gravity_torque(self, q: ArrayLike) -> Array:
        """The torques g (..., nv) that hold the robot at rest against gravity."""
        return self._ask("gravity-torque", q=q)[0]

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, ...]:
        """(kinetic, potential) energy, (...,) each, J."""
        return self._ask("energy", q=q, v=v)

    def centre_of_mass(self, q: ArrayLike) -> Array:
        """The centre of mass (..., 3), m, in the world."""
        return self._ask("centre-of-mass", q=q)[0]

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Linear momentum, then angular momentum about the centre of mass, (..., 6), along the world's axes."""
        return self._ask("momentum", q=q, v=v)[0]

    def frame_pose(self, q: ArrayLike, frame: str) -> tuple[Array, ...]:
        """Rotation R (..., 3, 3) and origin p (..., 3) of a frame: x_world = R x_frame + p."""
        return self._ask("frame-pose", None, {"frame": frame}, q=q)

    def frame_velocity(self, q: ArrayLike, v: ArrayLike, frame: str, axes: str = "aligned") -> Array:
        """Velocity (..., 6) of a frame: linear, then angular, along the axes of the world or ("local") its own."""
        return self._ask("frame-velocity", None, {"frame": frame, "axes": axes}, q=q, v=v)[0]

    def frame_jacobian(self, q: ArrayLike, frame: str, axes: str = "aligned") -> Array:
        """The Jacobian J (..., 6, nv) of a frame: J v is its velocity."""
        return self._ask("frame-jacobian", None, {"frame": frame, "axes": axes}, q=q)[0]

    def forward_dynamics_derivatives(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> tuple[Array, ...]:
        """(da_dq, da_dv, da_dtau), (..., nv, nv) each, along tangent directions."""
        return self._ask("forward-dynamics-derivatives", q=q, v=v, tau=tau)

    def inverse_dynamics_derivatives(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[Array, ...]:
        """(dtau_dq, dtau_dv, dtau_da), (..., nv, nv) each, along tangent directions."""
        return self._ask("inverse-dynamics-derivatives", q=q, v=v, a=a)

    def link_poses(self, q: ArrayLike) -> dict[str, Array]:
        """Where the links are, by name: position [m] and quaternion (x y z w), (..., 7) each."""
        poses = self._ask("kinematics", q=q)[0]
        return {name: poses[..., i, :] for i, name in enumerate(self.description["links"])}

    def _ask(
        self, what: str, f_ext: Wrenches | None = None, texts: Mapping[str, str] | None = None, **arguments: ArrayLike
    ) -> tuple[Array, ...]:
        """The arrays that answer a query by name. npz has no place for texts, so requests with texts are JSON."""
        arrays = {name: _array(name, value) for name, value in arguments.items()}
        wrenches = {frame: _array(f"f_ext[{frame!r}]", value) for frame, value in (f_ext or {}).items()}
        path = f"/v1/robots/{quote(self.id, safe='')}/{what}"
        if texts or all(array.ndim == 1 for array in (*arrays.values(), *wrenches.values())):
            body: dict[str, Any] = {**arrays, **(texts or {}), **({"f_ext": wrenches} if wrenches else {})}
            content = msgspec.json.encode(body, enc_hook=np.ndarray.tolist)
            answer = msgspec.json.decode(self._client.request("POST", path, content)[1])
        else:
            content = npz.write_npz({**arrays, **{f"f_ext.{frame}": array for frame, array in wrenches.items()}})
            with np.load(io.BytesIO(self._client.request("POST", path, content, npz.MEDIA_TYPE)[1])) as loaded:
                answer = dict(loaded)
        return tuple(np.asarray(value) for name, value in answer.items() if name != "frames")

    def __repr__(self) -> str:
        return f"<RemoteRobot {self.name!r}: nq={self.nq}, nv={self.nv}, {self.mass:.4g} kg, at {self._client.url}>"


def connect(url: str, token: str | None = None, timeout: float = 60.0) -> Client:
    """Connect to a service that `twolink serve` has started.

    Parameters
    ----------
    url : str
        Its address, such as "http://127.0.0.1:8000".
    token : str, optional
        A bearer token, if the service asks for one.
    timeout : float
        Seconds to wait for an answer.

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


def _array(name: str, value: Any) -> Array:
    """An argument as floats. Raises QueryError; what else is wrong with it, the service says."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise QueryError("expected an array of numbers", argument=name, remedy="give shape (..., n)") from None


def _problem(status: int, content: bytes) -> Problem:
    try:
        return msgspec.json.decode(content, type=Problem)
    except msgspec.MsgspecError:  # another server answered, such as a proxy
        remedy = "check that the address is that of a twolink service"
        return Problem("", "", status, f"HTTP status {status}", remedy=remedy, code="not-twolink")
