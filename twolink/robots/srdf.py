"""Contents of an SRDF beside a URDF: pairs of links that are not looked at for collisions, and named states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from twolink.errors import RobotError
from twolink.io.files import may_be_read
from twolink.io.text import parse_number, read_bytes
from twolink.robots.xml import parse_xml

MAX_BYTES = 2**22


@dataclass(frozen=True)
class Srdf:
    """apart: pairs of links that never or always touch. states: configurations by joint, by name. file: its name."""

    apart: frozenset[frozenset[str]] = frozenset()
    states: Mapping[str, Mapping[str, tuple[float, ...]]] = field(default_factory=dict)
    file: str = ""


def srdf_beside(urdf: Path | None, links: Iterable[str]) -> Srdf:
    """The SRDF of a URDF: the file in `../srdf` or beside it with whose stem that of the URDF begins, the longest.

    links: of the URDF, for what is said of a link and all others. Raises RobotError for a file that is not XML, or a
    state that is no number.
    """
    if urdf is None:
        return Srdf()
    folders = (urdf.parent, urdf.parent.parent / "srdf")
    beside = (path for folder in folders for path in folder.glob("*.srdf") if may_be_read(path))
    found = [path for path in beside if urdf.stem.startswith(path.stem)]
    if not found:
        return Srdf()
    path = max(found, key=lambda each: len(each.stem))
    root = parse_xml(read_bytes(path, RobotError, MAX_BYTES), path.name)
    alone = {one.attributes.get("link", "") for one in root.all("disable_default_collisions")}
    usual = {frozenset((one, other)) for one in alone for other in links if one != other}
    off_pairs, on_pairs = (
        {frozenset((one.attributes.get("link1", ""), one.attributes.get("link2", ""))) for one in root.all(tag)}
        for tag in ("disable_collisions", "enable_collisions")
    )
    states = dict[str, dict[str, tuple[float, ...]]]()
    for state in root.all("group_state"):
        values = states.setdefault(state.attributes.get("name", ""), {})
        for joint in state.all("joint"):
            try:
                values[joint.attributes["name"]] = tuple(map(parse_number, joint.attributes["value"].split()))
            except (KeyError, ValueError):
                raise RobotError("a joint of a state has no name or no numbers", where=f"{path.name}:{joint.line}",
                                 remedy="correct it, or move the SRDF away", code="xml") from None  # fmt: skip
    return Srdf(frozenset((usual - on_pairs) | off_pairs), states, path.name)
