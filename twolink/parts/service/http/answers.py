"""JSON answers of the API, as types: its description is made of them, and clients are generated from that."""

from typing import Any, Literal

import msgspec

from twolink.dynamics.robot_record import RobotRecord
from twolink.parts.service.problems import Problem
from twolink.parts.service.work.sandbox import Protection

Vector = list[float]
Table = list[Vector]
Object = dict[str, Any]


class Argument(msgspec.Struct):
    """An option of a query: what it is, and what can be chosen."""

    about: str
    choices: list[str | bool]


class Result(msgspec.Struct):
    """The answer of a query: the axes of one state, and the unit."""

    shape: list[str | int]
    unit: str


class QueryAbout(msgspec.Struct):
    """A dynamics query. method: of the Python class, empty where there is none."""

    name: str
    method: str
    summary: str
    arguments: dict[str, str]
    options: dict[str, Argument]
    results: dict[str, Result]


class ListedRobot(msgspec.Struct):
    """A robot in a list. The fields after `origin` depend on it: of the catalogue, or uploaded."""

    id: str
    name: str
    origin: Literal["catalogue", "uploaded"]
    source_package: str = msgspec.field(name="from", default="")
    usual_root: Literal["fixed", "free"] = "fixed"
    owner: str = ""
    created: float = 0.0
    nq: int = 0
    nv: int = 0
    mass: float = 0.0
    root: str = "fixed"
    source: str | None = None
    lock: Object | None = None


class RobotAbout(RobotRecord, frozen=True):
    """A robot: sizes, joints, links, and the report of what is suspicious, read, ignored, repaired and assumed."""

    id: str = ""
    origin: str = ""
    root: str = ""
    owner: str = ""


class ListedScene(msgspec.Struct):
    """A bundled scene."""

    id: str
    title: str
    robot: str
    duration: float
    effects: list[str]


class MethodAbout(msgspec.Struct):
    """A method that simulates."""

    name: str
    order: int
    kind: str
    adaptive: bool
    good_for: str
    source: str


class UnderstoodScene(msgspec.Struct):
    """A scene as it is understood, the fields of its effects included, and where its links are at the start."""

    title: str
    robot: RobotAbout
    duration: float
    q: Vector
    v: Vector
    effects: list[Object]
    frames: list[str]
    poses: list[Vector]


class QuantityAbout(msgspec.Struct):
    """A quantity that can be varied in a scene, with the scene's own value."""

    name: str
    kind: str
    unit: str
    about: str
    value: Any


class Linearized(msgspec.Struct):
    """dx/dt = A x + B u about a state with accelerations a, the bound on the error of A and B, and what follows."""

    q: Vector
    v: Vector
    t: float
    tau: Vector
    a: Vector
    A: Table
    B: Table
    names: list[str]
    inputs: list[str]
    error: float
    equilibrium: bool
    stability: str | None
    eigenvalues: Table
    eigenvalue_errors: list[float | None]
    controllable: int | None


class Samples(msgspec.Struct):
    """Columns of a run, thinned to `points` of its samples."""

    samples: int
    points: int
    columns: dict[str, list[float | None]]


class MotionAnswer(msgspec.Struct):
    """Poses of the links over time: [x, y, z, qx, qy, qz, qw] of each link, a frame."""

    t: Vector
    links: list[str]
    poses: list[Table]
    centre_of_mass: Table
    direction: Vector | None
    contacts: list[Object]
    forces: list[Object]


class Preview(msgspec.Struct):
    """A run that is kept nowhere."""

    result: Object
    columns: dict[str, list[float | None]]
    motion: MotionAnswer


class Column(msgspec.Struct):
    """A column of a sweep, in C order."""

    units: str
    long_name: str
    values: list[float | int | str | bool | None]


class SweepColumns(msgspec.Struct):
    """The results of a sweep, finished or not."""

    dims: list[str]
    shape: list[int]
    varied: dict[str, Column]
    statuses: list[str]
    columns: dict[str, Column]


class SweepRun(msgspec.Struct):
    """One run of a sweep: what varied, and the request that simulates it alone."""

    run: int
    values: Object
    simulation: Object


class Ready(msgspec.Struct):
    """The readiness of the service for its work."""

    status: str
    version: str


class Health(Ready):
    """The state of the service: its version, jobs that wait or run, bytes kept, and what keeps workers in."""

    jobs: int
    bytes: int
    sandbox: Protection


class Job(msgspec.Struct):
    """A job: what was asked for, how far it is, and what came of it. seconds: since it began to run."""

    id: str
    kind: str
    state: Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
    owner: str
    created: float
    request: Any
    problem: Problem | None
    seconds: float | None
    progress: Object | None
    result: Object | None = None
