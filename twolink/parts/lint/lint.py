"""lint: every defect of a robot's file at once."""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from twolink.errors import RobotError
from twolink.io.files import write_atomic
from twolink.io.text import read_bytes
from twolink.parts.lint import bodies, joints
from twolink.parts.lint.findings import SEVERITIES, Defect, Findings, Fix, defect
from twolink.parts.lint.reading import Reading, of_error, read
from twolink.parts.lint.shapes import floats
from twolink.robots.catalogue import Source, open_source
from twolink.robots.checks import weightless_joints, without_inertia
from twolink.robots.load import load_model
from twolink.robots.model import RobotModel
from twolink.robots.suspicions import between_joints, suspicious
from twolink.robots.xml import MAX_BYTES, Element, parse_xml

CHECKS: tuple[Callable[[Reading], Iterator[Defect]], ...] = (
    bodies.impossible, bodies.without_inertia, bodies.beside_shapes, bodies.mirrored_bodies, joints.axes, joints.limits,
    joints.mimics, joints.mirrored_joints, joints.shapes, joints.ranges,
)  # fmt: skip
_NOT_OF_THE_FILE = ("no-counterpart", "missing-extra", "too-large", "not-allowed")


def lint(
    robot: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    xacro_arguments: Mapping[str, object] | None = None,
    baseline: str | os.PathLike[str] | Findings | None = None,
) -> Findings:
    """Find every defect of a robot's file at once.

    Parameters
    ----------
    robot : str or path
        The path of a URDF, xacro, MJCF or SRDF, a name of `tl.robots()`, or text.
    package_dirs : sequence of paths
        Roots of package://, as in `load_robot`.
    xacro_arguments : mapping, optional
        Of a xacro.
    baseline : Findings or path, optional
        Findings that are known, also from a .json file: only new ones are given.

    Returns
    -------
    Findings
        The defects, each with rule, place, value, expectation and likely cause. Where `load_robot` refuses the file,
        one at least is an error, but for a robot without any <inertial>: it is for kinematics.

    Raises
    ------
    RobotError
        The file cannot be opened.
    MissingExtraError
        It is a xacro or an MJCF, and what expands or compiles it is not installed.
    """
    source, folders = open_source(robot), [Path(folder) for folder in package_dirs]
    found = list(_defects(source, folders, dict(xacro_arguments or {}), robot))
    name = os.path.relpath(source.path) if source.path is not None else source.label
    name = name if not name.startswith("..") else str(source.path)
    order = {level: k for k, level in enumerate(SEVERITIES)}
    named = sorted((replace(one, file=name) for one in dict.fromkeys(found)),
                   key=lambda one: (one.line, order[one.severity], one.rule))  # fmt: skip
    result = Findings((name,), tuple(named))
    return result if baseline is None else result.since(baseline)


def _defects(source: Source, folders: list[Path], arguments: Mapping[str, object], robot: Any) -> Iterator[Defect]:
    if source.path is not None and source.path.suffix == ".srdf":
        yield from srdf_defects(source)
        return
    reading = read(source, folders, arguments)
    if not isinstance(reading, Reading):
        yield from reading
        if b"<mujoco" in source.data and not any(one.rule == "xml" for one in reading):  # MuJoCo says its first defect
            yield from bodies.written_inertias(parse_xml(source.data, source.label, source.encoding))
        return
    own = [*reading.found, *(one for check in CHECKS for one in check(reading)), *_suspicious(reading)]
    is_massless = bool(reading.moving) and not any(link.has_inertial for link in reading.links.values())
    if is_massless:  # said once, not of each link
        own = [one for one in own if one.rule != "no-inertial"]
        own.append(defect("weightless", "", 0, "no link has an <inertial>: joints have no acceleration",
                          'give the links masses and inertias; for kinematics, purpose="kinematics" loads it',
                          severity="warning"))  # fmt: skip
    yield from own
    if not any(one.severity == "error" for one in own):
        try:
            if reading.raw.tag != "mujoco":
                load_model(RobotModel, robot, package_dirs=folders, xacro_arguments=arguments,
                           root=source.entry.usual_root if source.entry else "fixed")  # fmt: skip
            elif names := weightless_joints(reading.model):  # MuJoCo has compiled it, which can take seconds
                raise without_inertia(reading.tree, reading.model, names)  # type: ignore[arg-type]
        except RobotError as error:
            rule = "weightless" if error.code == "no-inertia" else "refused"
            if error.code not in _NOT_OF_THE_FILE and not (is_massless and rule == "weightless"):
                yield of_error(error, rule)


def _suspicious(reading: Reading) -> Iterator[Defect]:
    """The suspicions of the load report, and what it assumes of links between joints: a note."""
    if reading.tree is None or reading.model is None:
        return
    owners: dict[str, Any] = {joint.name: joint for joint in reading.joints} | dict(reading.links)
    for one in (*suspicious(reading.tree, reading.model), *between_joints(reading.tree, reading.model)):
        for name in one.names:
            owner = owners[name].element
            value, *cause = re.split(": |; ", one.what, maxsplit=1)
            yield defect(one.rule, name, reading.line(owner, name), value, "".join(cause),
                         severity="note" if one.kind == "assumed" else None)  # fmt: skip


def fix(findings_of: Findings) -> tuple[Path, ...]:
    """Write the corrections that are certain into the files. Returns the files that changed."""
    files: dict[Path, bytes] = {}  # as bytes: in whatever encoding, with whatever ends of lines
    for one in findings_of.defects:
        if one.fix is not None and one.line:
            lines = files.setdefault(Path(one.file), Path(one.file).read_bytes()).splitlines(keepends=True)
            files[Path(one.file)] = b"".join(lines[: one.line - 1]) + _fixed(b"".join(lines[one.line - 1 :]), one.fix)
    changed = tuple(path for path, data in files.items() if data != path.read_bytes())
    for path in changed:
        write_atomic(path, lambda stream, path=path: stream.write(files[path]))  # type: ignore[misc]
    return changed


def _fixed(data: bytes, change: Fix) -> bytes:
    """The content with the first such attribute corrected."""
    pattern = rf"(<{change.tag}\b[^<>]*?\s{change.key}\s*=\s*)(['\"]){re.escape(change.old)}\2"
    new = change.new.encode()
    return re.sub(pattern.encode(), lambda found: found[1] + found[2] + new + found[2], data, count=1)


def srdf_defects(source: Source) -> Iterator[Defect]:
    """The defects of an SRDF. Names are compared with the URDF of its name, beside it or in ../urdf or ../robots."""
    try:
        root = parse_xml(source.data, source.label)
    except RobotError as error:
        yield of_error(error, "xml")
        return
    known = _names(source)
    seen: set[frozenset[str]] = set()
    for element in root.children:
        pair = [element.attributes.get(key, "") for key in ("link1", "link2")]
        if element.tag == "disable_collisions":
            if frozenset(pair) in seen or pair[0] == pair[1]:
                what = f"the pair {pair[0]!r}, {pair[1]!r} stands twice, or is one link"
                yield defect("srdf", pair[0], element.line, what, "leave it out")
            seen.add(frozenset(pair))
        if element.tag in ("disable_collisions", "enable_collisions"):
            yield from _unknown(element, "link", pair, known)
        if element.tag == "disable_default_collisions":
            yield from _unknown(element, "link", [element.attributes.get("link", "")], known)
        for part in element.children:
            if part.tag in ("joint", "link"):
                yield from _unknown(part, part.tag, [part.attributes.get("name", "")], known)
            if element.tag == "group_state" and not floats(part.attributes.get("value", "")):
                yield defect("srdf", part.attributes.get("name", ""), part.line,
                             f'value="{part.attributes.get("value", "")}" is no number', "give rad or m")  # fmt: skip


def _names(source: Source) -> dict[str, set[str]]:
    """The names of links and joints of the URDF; none where it is not found."""
    if source.path is None:
        return {}
    folders = (source.path.parent, *(source.path.parent.parent / name for name in ("urdf", "robots")))
    found = next((file for folder in folders if (file := folder / f"{source.path.stem}.urdf").is_file()), None)
    if found is None:
        return {}
    root = parse_xml(read_bytes(found, RobotError, MAX_BYTES), found.name)
    return {tag: {each.attributes.get("name", "") for each in root.all(tag)} for tag in ("link", "joint")}


def _unknown(element: Element, tag: str, names: list[str], known: dict[str, set[str]]) -> Iterator[Defect]:
    for name in names:
        if known and name not in known[tag]:
            yield defect("srdf", name, element.line, f"the URDF has no {tag} {name!r}", "correct the name")
