"""From elements to a kinematic tree: unique names, one root, no cycle, not absurdly deep."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

from twolink.errors import RobotError, nearest
from twolink.robots.urdf import Joint, Link, Reader, read_joint, read_link
from twolink.robots.xml import Element

# Pinocchio recurses over the tree while reading: 5,000 chained links overflow an 8 MiB stack and end the process.
MAX_JOINTS = 5_000
MAX_DEPTH = 1_000
# A pin.Data holds tensors of nv^3 numbers (second derivatives): 0.9 GB at nv = 300, 32 GB at nv = 1,000.
MAX_MOVING = 300


@dataclass(frozen=True)
class Tree:
    """A URDF whose structure is sound: `joints` in an order that meets every parent before its children."""

    name: str
    element: Element
    links: dict[str, Link]
    joints: tuple[Joint, ...]
    root: str

    @property
    def moving(self) -> tuple[Joint, ...]:
        """The joints that move."""
        return tuple(j for j in self.joints if j.type != "fixed")


def read_tree(element: Element, source: str) -> Tree:
    """The tree in a <robot> element. Raises RobotError that names the link or joint at fault."""
    _require_robot(element, source)
    reader = Reader(source)
    links = [read_link(reader, e) for e in element.all("link")]
    joints = element.all("joint")
    if not links:
        raise RobotError("it has no <link>", where=source, remedy="a robot needs at least one link")
    if len(joints) > MAX_JOINTS:
        raise RobotError(
            f"{len(joints)} joints, the limit is {MAX_JOINTS}", where=source, remedy="load a smaller robot"
        )
    read_joints = [read_joint(reader, e) for e in joints]
    moving = sum(j.type != "fixed" for j in read_joints)
    if moving > MAX_MOVING:
        raise RobotError(
            f"{moving} moving joints, the limit is {MAX_MOVING}",
            where=source,
            remedy="Pinocchio needs memory in proportion to their cube: load a smaller robot",
        )
    for items in (links, read_joints):
        _require_unique(items)
    by_name = {link.name: link for link in links}
    _require_links_exist(read_joints, by_name)
    root = _single_root(by_name, read_joints, source)
    return Tree(element.attributes.get("name", ""), element, by_name, _ordered(root, by_name, read_joints), root)


def _require_robot(root: Element, source: str) -> None:
    if root.tag != "robot":
        known = {"sdf": "it is SDF", "mujoco": "it is MJCF", "html": "it is a web page"}.get(root.tag, "")
        raise RobotError(
            f"the top element is <{root.tag}>, expected <robot>{', ' + known if known else ''}",
            where=f"{source}:{root.line}",
            remedy="pass a URDF",
        )
    stack = [root]
    while stack:
        element = stack.pop()
        values = element.attributes.items()
        if element.tag.startswith("xacro:") or any("${" in v or "$(" in v for k, v in values if k != "name"):
            raise RobotError(
                f"<{element.tag}> is xacro, a macro language that has to be expanded first",
                where=f"{source}:{element.line}",
                remedy="pip install xacrodoc, then load_robot(xacrodoc.XacroDoc.from_file(path).to_urdf_string())",
            )
        # Gazebo's and the controllers' blocks hold $(...) of their own; they are ignored as a whole.
        stack.extend(
            c
            for c in element.children
            if element is not root or c.tag in ("link", "joint") or c.tag.startswith("xacro:")
        )


def _require_unique(items: list[Link] | list[Joint]) -> None:
    for name, count in Counter(item.name for item in items).items():
        if count > 1:
            twins = [item for item in items if item.name == name]
            raise RobotError(f"the name is used {count} times", where=twins[1].where, remedy="rename one of them")


def _require_links_exist(joints: list[Joint], links: dict[str, Link]) -> None:
    for joint in joints:
        for role, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                raise RobotError(f"{role} link {name!r} does not exist", where=joint.where, remedy=nearest(name, links))


def _single_root(links: dict[str, Link], joints: list[Joint], source: str) -> str:
    carriers: dict[str, Joint] = {}
    for joint in joints:
        other = carriers.setdefault(joint.child, joint)
        if other is not joint:
            raise RobotError(
                f"link {joint.child!r} is already the child of joint {other.name!r}",
                where=joint.where,
                remedy="a URDF is a tree: give the link one parent, and close loops elsewhere",
            )
    roots = [name for name in links if name not in carriers]
    if not roots:
        raise RobotError(f"the joints form a cycle: {_cycle(carriers)}", where=source, remedy="remove one of them")
    if len(roots) > 1:
        raise RobotError(
            f"{len(roots)} root links: {', '.join(map(repr, roots[:5]))}",
            where=source,
            remedy="connect them with joints, or remove all but one",
        )
    return roots[0]


def _cycle(carriers: dict[str, Joint]) -> str:
    """The links around one cycle, by walking from child to parent until a link comes again."""
    seen: list[str] = []
    link = next(iter(carriers))
    while link not in seen and link in carriers:
        seen.append(link)
        link = carriers[link].parent
    loop = [*seen[seen.index(link) :], link] if link in seen else seen
    return " <- ".join(loop[:8]) + (" ..." if len(loop) > 8 else "")


def _ordered(root: str, links: dict[str, Link], joints: list[Joint]) -> tuple[Joint, ...]:
    children: dict[str, list[Joint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    queue = deque([(root, 0)])
    reached = {root}
    while queue:
        link, depth = queue.popleft()
        if depth > MAX_DEPTH:
            raise RobotError(
                f"more than {MAX_DEPTH} joints lie between it and the root",
                where=f"link {link!r}",
                remedy="load a shorter chain",
            )
        for joint in children.get(link, []):
            ordered.append(joint)
            reached.add(joint.child)
            queue.append((joint.child, depth + 1))
    stray = [name for name in links if name not in reached]
    if stray:  # one root, but a cycle of its own beside the tree
        carriers = {j.child: j for j in joints if j.child in stray}
        raise RobotError(
            f"the joints form a cycle: {_cycle(carriers)}",
            where=links[stray[0]].where,
            remedy="remove one of the joints",
        )
    return tuple(ordered)
