"""Loading: name, path or text -> bytes -> elements -> tree -> pin.Model -> checks -> RobotModel."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, nearest
from twolink.robots import catalogue, meshes
from twolink.robots import physical_checks as physics
from twolink.robots.canonical import canonical
from twolink.robots.findings import findings
from twolink.robots.joint_layout import joint_layouts
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.model import RobotModel, Visuals
from twolink.robots.pinocchio_check import check_agreement
from twolink.robots.tree import Tree, read_tree
from twolink.robots.xml import MAX_BYTES, parse_xml

Lock = Mapping[str, float | Sequence[float]]
R = TypeVar("R", bound=RobotModel)

_STACK = 64 * 2**20
_stack_size_lock = threading.Lock()


@dataclass(frozen=True)
class _Source:
    """Where a URDF comes from."""

    label: str
    data: bytes
    path: Path | None
    entry: catalogue.Entry | None
    encoding: str | None = None


def load_model(
    kind: type[R],
    source: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    root: Literal["fixed", "free"] = "fixed",
    lock: Lock | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    mimic: bool = False,
    unphysical: Literal["refuse", "report"] = "refuse",
) -> R:
    """A robot of class `kind` from a catalogue name, a path, or URDF text; see `twolink.load_robot`."""
    _require_choice("root", root, ("fixed", "free"))
    _require_choice("unphysical", unphysical, ("refuse", "report"))
    field = _gravity(gravity)
    read = _open(source)
    tree = read_tree(parse_xml(read.data, read.label, read.encoding), read.label)
    if mimic:
        _check_mimic(tree)
    full = _build(tree, read, root, mimic)
    check_agreement(full, tree, read.label, root)
    locked, reference = _locked(full, lock or {})
    model = _reduced(full, locked, reference)
    model.gravity.linear = field
    found = physics.check_bodies(tree, full, unphysical)
    physics.check_invertible(tree, model)
    base = None if read.path is None else read.path.parent
    dirs = meshes.search_path(_folders(package_dirs), read.path, catalogue.examples_share())
    report = LoadReport(
        read.label,
        (
            _summary(tree, model, read),
            *found,
            *findings(tree, root=root, mimic=mimic, reduced=bool(locked)),
            *_mesh_findings(tree, dirs, base),
            *_choices(read, root, lock, field),
            *_beyond_limits(full, locked, reference),
        ),
    )
    visuals = Visuals(meshes.without_missing(tree.element, dirs, base), full, locked, reference)
    name = read.entry.name if read.entry else tree.name or read.label
    return kind(name, model, report, visuals)


def _open(source: str | os.PathLike[str]) -> _Source:
    """Text when it looks like XML, a file when it looks like a path, else a catalogue name."""
    if isinstance(source, str) and "<" in source:
        return _Source("URDF text", source.encode("utf-8", "surrogatepass"), None, None, "utf-8")
    if not isinstance(source, (str, os.PathLike)):
        raise RobotError(
            f"a {type(source).__name__} is not a robot",
            where="load_robot",
            remedy="pass a name, a path or URDF text",
        )
    text = os.fspath(source)
    if not isinstance(text, str) or not text.strip():
        raise RobotError("the source is empty", where="load_robot", remedy="pass a name, a path or URDF text")
    looks_like_path = isinstance(source, os.PathLike) or os.sep in text or text.endswith((".urdf", ".xml", ".xacro"))
    if not looks_like_path and (text in catalogue.catalogue_names() or not os.path.isfile(text)):
        entry = catalogue.find(text)
        return _Source(entry.path.name, _read_bytes(entry.path), entry.path, entry)
    path = Path(text)
    return _Source(path.name, _read_bytes(path), path, None)


def _read_bytes(path: Path) -> bytes:
    """The file, of which no more is read than may be: some have no size, and no end."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        detail = getattr(error, "strerror", None) or str(error)
        raise RobotError(f"cannot be read: {detail}", where=str(path), remedy="check the path") from None
    return data


def _build(tree: Tree, read: _Source, root: str, mimic: bool) -> pin.Model:
    """Pinocchio's model, built on a thread whose stack holds the deepest tree we let through."""
    names = {j.name for j in tree.joints}
    own = ("universe", "root_joint") if root == "free" else ("universe",)
    reserved = next((name for name in own if name in names), None)
    if reserved is not None:
        raise RobotError(
            f"Pinocchio keeps the joint name {reserved!r} for itself",
            where=read.label,
            remedy="rename the joint",
        )
    arguments = [canonical(tree), *([pin.JointModelFreeFlyer()] if root == "free" else []), mimic]
    result: list[pin.Model | Exception] = []

    def work() -> None:
        try:
            result.append(pin.buildModelFromXML(*arguments))
        except Exception as error:  # back-end errors of any type are translated below
            result.append(error)

    with _stack_size_lock:
        before = threading.stack_size(_STACK)
        try:
            thread = threading.Thread(target=work, name="twolink-load")
            thread.start()
        finally:
            threading.stack_size(before)
    thread.join()
    if isinstance(result[0], Exception):
        raise RobotError(
            f"Pinocchio refuses it: {result[0]}",
            where=read.label,
            remedy="the messages of its parser are on stderr",
        )
    return result[0]


def _check_mimic(tree: Tree) -> None:
    names = [j.name for j in tree.joints]
    for joint in tree.joints:
        if joint.mimic is not None and (joint.mimic not in names or joint.mimic == joint.name):
            raise RobotError(
                f"it mimics {joint.mimic!r}, which is not another joint",
                where=joint.where,
                remedy=nearest(joint.mimic, [n for n in names if n != joint.name]),
            )


def _locked(model: pin.Model, lock: Lock) -> tuple[tuple[int, ...], np.ndarray]:
    """Indices of the joints to lock, and a configuration that holds their values."""
    if not isinstance(lock, Mapping):
        raise RobotError(f"expected joints with their configurations, got {lock!r}", argument="lock",
                         remedy="such as {'elbow': 0.5}")  # fmt: skip
    reference = np.asarray(pin.neutral(model))
    layouts = {joint.name: joint for joint in joint_layouts(model)}
    for name, value in lock.items():
        if name not in layouts:
            what = f"there is no moving joint {name!r} to lock"
            raise RobotError(what, argument="lock", remedy=nearest(str(name), list(layouts)))
        joint = layouts[name]
        size = joint.q.stop - joint.q.start
        values = _numbers(value)
        if joint.kind == "cos-sin" and values.size == 1:  # a continuous joint is locked at an angle
            values = np.array([np.cos(values[0]), np.sin(values[0])])
        if values.shape != (size,) or not np.isfinite(values).all():
            expected = f"expected {size} finite number{'s' if size > 1 else ''}"
            raise RobotError(f"{expected}, got {value!r}", argument=f"lock[{name!r}]", remedy="give its configuration")
        reference[joint.q] = values
        if joint.unit is not None and not abs(np.linalg.norm(reference[joint.unit]) - 1) <= 1e-8:
            length = float(np.linalg.norm(reference[joint.unit]))
            what = f"quaternion or (cos, sin), expected length 1, got {length:.12g}"
            raise RobotError(what, argument=f"lock[{name!r}]", remedy="divide it by its length")
    return tuple(sorted(layouts[name].index for name in lock)), reference


def _beyond_limits(model: pin.Model, locked: tuple[int, ...], reference: np.ndarray) -> list[Finding]:
    names = [
        model.names[j]
        for j in locked
        if model.nqs[j] == 1
        and not (
            model.lowerPositionLimit[model.idx_qs[j]]
            <= reference[model.idx_qs[j]]
            <= model.upperPositionLimit[model.idx_qs[j]]
        )
    ]
    return [Finding("assumed", "joints locked beyond their limits", tuple(names))] if names else []


def _reduced(model: pin.Model, locked: tuple[int, ...], reference: np.ndarray) -> pin.Model:
    if not locked:
        return model.copy()
    try:
        return pin.buildReducedModel(model, list(locked), reference)
    except Exception as error:
        raise RobotError(
            f"Pinocchio cannot lock these joints: {error}", argument="lock", remedy="load it with mimic=False"
        ) from None


def _gravity(gravity: Sequence[float]) -> np.ndarray:
    field = _numbers(gravity)
    if field.shape != (3,) or not np.isfinite(field).all():
        raise RobotError(
            f"expected 3 finite numbers, got {gravity!r}",
            argument="gravity",
            remedy="give m/s^2 in the world's axes, such as (0, 0, -9.81)",
        )
    return field


def _folders(package_dirs: Sequence[str | os.PathLike[str]]) -> list[Path]:
    try:
        if isinstance(package_dirs, (str, os.PathLike)):
            return [Path(package_dirs)]
        return [Path(d) for d in package_dirs]
    except TypeError:
        raise RobotError(f"expected folders, got {package_dirs!r}", where="package_dirs",
                         remedy='such as ["/opt/ros/share"]') from None  # fmt: skip


def _numbers(value: object) -> np.ndarray:
    """A value as an array of one axis or more; an empty one when it holds no numbers."""
    try:
        return np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def _require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise RobotError(f"{value!r} is unknown", argument=name, remedy=nearest(str(value), choices))


def _summary(tree: Tree, model: pin.Model, read: _Source) -> Finding:
    kinds: dict[str, int] = {}
    for joint in tree.joints:
        kinds[joint.type] = kinds.get(joint.type, 0) + 1
    joints = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "no joints"
    mass = sum(link.mass for link in tree.links.values())
    return Finding(
        "read",
        f"robot {tree.name!r}: {len(tree.links)} links of {mass:.6g} kg, {joints}; "
        f"nq = {model.nq}, nv = {model.nv} ({len(read.data)} bytes)",
    )


def _mesh_findings(tree: Tree, dirs: Sequence[Path], base: Path | None) -> list[Finding]:
    names = meshes.missing(tree.element, dirs, base)
    what = "meshes that are not found (dynamics do not need them; give package_dirs= to draw them)"
    return [Finding("ignored", what, names)] if names else []


def _choices(read: _Source, root: str, lock: Lock | None, field: np.ndarray) -> list[Finding]:
    found = [Finding("assumed", f"gravity ({field[0]:g}, {field[1]:g}, {field[2]:g}) m/s^2")]
    if lock:
        found.append(Finding("assumed", "locked joints: merged as if they were fixed", tuple(lock)))
    if read.entry is not None and read.entry.usual_root == "free" and root == "fixed":
        found.append(Finding("assumed", 'this robot is meant to move about; root="free" frees its base'))
    return found
