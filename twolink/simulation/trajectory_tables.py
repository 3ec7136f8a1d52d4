"""The samples of a trajectory as named columns; saved files; xarray and pandas; the curves of figures."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import Names, instance, texts
from twolink.dynamics.robot_record import find_robot, require_same
from twolink.errors import AccuracyError, SceneError, ShowError, import_extra, require_known
from twolink.integrate.solution import Event
from twolink.io.bags import is_bag
from twolink.io.tables import read_table
from twolink.robots.joint_layout import joint_columns, unit_of, without_angles

EXTRA = "sweeps"  # of twolink, which installs xarray and pandas
# Before the names of contacts, for columns (n, 6 k), and of wrenches on links, (n, 9 k), which older files have without
# moments; the names of notes.
CONTACT, WRENCH, FORCE, EVENTS, ACCURACY = "contact ", "wrench ", "force ", "events", "accuracy"
Marks = Mapping[str, tuple[np.ndarray, ...]]  # see Trajectory.contacts and wrenches_on_links
Run = Any  # a Trajectory, whose module imports this one
SMOOTH = 400  # times that make a smooth curve
Curves = tuple[np.ndarray, np.ndarray, np.ndarray]
UNITS = {"t": "s", "q": "rad or m", "v": "rad/s or m/s", "tau": "N m or N", "z": "SI units", "energy": "J",
         "error": "rad or m"}  # fmt: skip


def coordinate_names(robot: Robot, letter: str) -> list[str]:
    """The joint names of the coordinates "q" or "v", numbered where a joint has several."""
    return [column.removeprefix(f"{letter}.") for column, _ in joint_columns(robot.joints, letter)]


def largest_error(error: np.ndarray | None, robot: Robot, since: str | None) -> str:
    """The largest of the errors of q (n,), in words. since: from when on they are estimates; None for bounds."""
    if error is None:
        return "not verified"
    words = f"{error.max():.1e} {unit_of(robot.joints)}" if error.any() else "none seen"
    return f"{words}, estimated{since}" if since is not None else f"at most {words}" if error.any() else words


def columns(run: Run, tau: np.ndarray | None) -> dict[str, np.ndarray]:
    """The samples by name: t, q.JOINT, v.JOINT, tau.JOINT, z.STATE, energy, error; the torques (n, nv) are passed.

    Raises
    ------
    SceneError
        Two columns have the same name; code "column-twice".
    """
    table = {"t": run.t}
    torques = () if tau is None else (("tau", tau),)
    for letter, values in (("q", run.q), ("v", run.v), *torques):
        for (column, joint), numbers in zip(joint_columns(run.robot.joints, letter), values.T, strict=True):
            if column in table:
                raise SceneError(f"two columns are named {column!r}", where=f"joint {joint!r}",
                                 remedy="rename the joint in the URDF", code="column-twice")  # fmt: skip
            table[column] = numbers
    table |= {f"z.{name}": values for name, values in run.states.items()}
    table["energy"] = run.energy
    if run.error is not None:
        table["error"] = run.error
    return table


def mark_columns(contacts: Marks, wrenches: Marks) -> dict[str, np.ndarray]:
    """Contacts and wrenches on links as columns: of each of k points its place and the force, and the moment."""
    return {kind + name: np.concatenate(rows, axis=2).reshape(len(rows[0]), -1)
            for kind, found in ((CONTACT, contacts), (WRENCH, wrenches)) for name, rows in found.items()}  # fmt: skip


def mark_notes(events: Sequence[Event], accuracy: float | None) -> dict[str, str]:
    """Events, and the accuracy asked for, as notes."""
    return {name: msgspec.json.encode(value, enc_hook=np.generic.item).decode()
            for name, value in ((EVENTS, list(events)), (ACCURACY, accuracy))}  # fmt: skip


def chosen_columns(table: Mapping[str, np.ndarray], given: Names, t: np.ndarray) -> dict[str, np.ndarray]:
    """Some columns by name and unit, at times t (m,). Raises SceneError for a name that is none, with the nearest."""
    names = texts(given, "curves", ShowError, "such as 'energy' or ['q.elbow']")
    for name in names:
        require_known(name, table, SceneError, "there is no column {!r}", where="curves")
    return {f"{name} ({UNITS[name.partition('.')[0]]})": np.interp(t, table["t"], table[name]) for name in names}


def read_run(path: Path, robot: Robot | None, make: Callable[..., Run]) -> Run:
    """A saved trajectory, of the robot that the file names, or of the one passed. Raises SceneError."""
    label = str(path)
    content, notes = read_table(path)
    own = None if robot is None else instance(robot, Robot, "robot", SceneError)
    robot = find_robot(notes, label) if own is None else require_same(own, notes, label)
    marks = {name: content.pop(name) for name in list(content) if name.startswith((CONTACT, WRENCH, FORCE))}
    table = without_angles(_numbers(content, label), robot.joints)
    n = len(table["t"]) if "t" in table else 0
    error = np.empty(n) if "error" in table else None
    states = {name.removeprefix("z."): np.empty(n) for name in table if name.startswith("z.")}
    has_tau = not is_bag(path) and any(name.startswith("tau.") for name in table)
    contacts, wrenches = _marks(marks, n, label) if EVENTS in notes else (None, None)
    tau = np.empty((n, robot.nv)) if has_tau else None
    run = make(robot, np.empty(n), np.empty((n, robot.nq)), np.empty((n, robot.nv)), error, None,
               _noted(notes, EVENTS, "[]", tuple[Event, ...], label),
               accuracy=_noted(notes, ACCURACY, "null", float | None, label), recorded_energy=np.empty(n),
               title=notes.get("title", ""), estimated=notes.get("bound") == "estimated", recorded_contacts=contacts,
               recorded_wrenches=wrenches, states=states, recorded_tau=tau)  # fmt: skip
    wanted = columns(run, tau)
    if is_bag(path):
        known = wanted if "robot" in notes else {name: place for name, place in wanted.items() if name != "energy"}
        table = {name: x for name, x in table.items() if name in known or ("robot" in notes and name[:4] != "tau.")}
        wanted = known
    missing = [name for name in wanted if name not in table]
    unknown = [name for name in table if name not in wanted]
    if missing or unknown:
        what = f"column {missing[0]!r} is not in it" if missing else f"column {unknown[0]!r} is unknown"
        raise SceneError(what, where=label, remedy=f"it is not a trajectory of robot {robot.name!r}")
    for name, place in wanted.items():
        place[:] = table[name]
    if "energy" not in wanted:
        run.energy[:] = np.sum(robot.energy(run.q, run.v), axis=0)
    if np.any(np.diff(run.t) <= 0):
        row = int(np.argmax(np.diff(run.t) <= 0)) + 1
        raise SceneError(f"t does not increase at sample {row}", where=label, remedy="sort its samples by time")
    return run


def _noted(notes: Mapping[str, str], name: str, left_out: str, kind: Any, label: str) -> Any:
    """The content of a note, or of what stands for one that is left out."""
    try:
        return msgspec.json.decode(notes.get(name, left_out), type=kind)
    except msgspec.DecodeError as error:
        raise SceneError(f"its note of {name} is damaged: {error}", where=label, remedy="save it again") from None


def _marks(columns: Mapping[str, np.ndarray], n: int, label: str) -> tuple[Marks, Marks]:
    """Points and forces (n, k, 3) of contacts by name, and with moments those on links."""
    found: dict[str, dict[str, tuple[np.ndarray, ...]]] = {CONTACT: {}, WRENCH: {}, FORCE: {}}
    for column, values in columns.items():
        kind, vectors = next((one, 3 if one == WRENCH else 2) for one in found if column.startswith(one))
        if values.dtype.kind != "f" or values.ndim != 2 or len(values) != n or values.shape[1] % (3 * vectors):
            raise SceneError(f"column {column!r} is not a table of forces", where=label, remedy="save it again")
        rows = tuple(np.moveaxis(values.reshape(n, -1, vectors, 3), 2, 0))
        found[kind][column.removeprefix(kind)] = rows
    older = {name: (points, forces, np.zeros_like(forces)) for name, (points, forces) in found[FORCE].items()}
    return found[CONTACT], older | found[WRENCH]


def _numbers(content: Mapping[str, np.ndarray], label: str) -> dict[str, np.ndarray]:
    """The columns as finite floats (n,), equally long, n > 0."""
    table = {}
    for name, values in content.items():
        if np.ndim(values) != 1 or np.asarray(values).dtype.kind not in "fiu":
            raise SceneError(f"column {name!r} is not a row of numbers", where=label, remedy="save it again")
        table[name] = np.asarray(values, dtype=float)
    lengths = {name: len(values) for name, values in table.items()}
    odd = next((name for name in lengths if lengths[name] != lengths.get("t", lengths[name])), None)
    if odd is not None:
        what = f"column {odd!r} has {lengths[odd]} samples, t has {lengths['t']}"
        raise SceneError(what, where=label, remedy="save it again")
    if not any(lengths.values()) or not all(np.isfinite(values).all() for values in table.values()):
        raise SceneError("it has no samples, or some that are not finite", where=label, remedy="save it again")
    return table


def as_dataset(run: Run, attributes: Mapping[str, Any]) -> Any:
    """An xarray.Dataset with dimensions time, q_name and v_name. Raises MissingExtraError."""
    xarray = import_extra("xarray", EXTRA)
    variables = {
        "q": (("time", "q_name"), run.q, {"units": UNITS["q"]}),
        "v": (("time", "v_name"), run.v, {"units": UNITS["v"]}),
        "energy": ("time", run.energy, {"units": UNITS["energy"]}),
    }
    variables |= {f"z.{name}": ("time", values, {"units": UNITS["z"]}) for name, values in run.states.items()}
    if run.error is not None:
        variables["error"] = ("time", run.error, {"units": UNITS["error"]})
    coordinates = {
        "time": ("time", run.t, {"units": UNITS["t"]}),
        "q_name": coordinate_names(run.robot, "q"),
        "v_name": coordinate_names(run.robot, "v"),
    }
    return xarray.Dataset(variables, coordinates, dict(attributes))


def drawn_curves(run: Run, *, whole: bool = False) -> tuple[Curves, tuple[np.ndarray, np.ndarray]]:
    """(t, q, v), and times with energies: where the robots of the samples change, the energies at the samples."""
    t, q, v = states(run, whole=whole)
    if t is run.t or len(run.robots) > 1:
        return (t, q, v), (run.t, run.energy)
    robot = run.robots[0][0] if run.robots else run.robot
    return (t, q, v), (t, np.sum(robot.energy(q, v), axis=0))


def drawn_marks(run: Run) -> dict[str, Marks]:
    """The contacts and forces on links at the times of `states`, those of the sample before."""
    rows = np.searchsorted(run.t, states(run)[0], side="right") - 1
    kinds = {"contacts": run.contacts, "forces": run.forces_on_links}
    return {kind: {name: tuple(part[rows] for part in parts) for name, parts in found.items()}
            for kind, found in kinds.items()}  # fmt: skip


def states(run: Run, *, whole: bool = False) -> Curves:
    """(t, q, v), between few samples by the solution itself, if it is kept and not stepped.

    whole: from the start of the solution, not from the first sample on.
    """
    own = run.t, run.q, run.v
    if run.solution is None or len(run.t) >= SMOOTH or run.contact_record is not None:
        return own
    begin = run.solution.t[0] if whole else run.t[0]
    times = np.union1d(run.t, np.linspace(begin, run.t[-1], SMOOTH))
    try:
        return times, *run.at(times)
    except AccuracyError:
        return own
