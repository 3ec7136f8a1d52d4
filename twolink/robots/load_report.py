"""The load report: what is suspicious, and what was read, ignored, repaired and assumed when a robot was loaded."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from twolink.io.text import facts_html
from twolink.robots.joint_layout import NO_LIMIT
from twolink.robots.tree import Tree
from twolink.robots.urdf import UrdfJoint
from twolink.robots.xml import Element, Foreign

Kind = Literal["suspicious", "read", "ignored", "repaired", "assumed"]
KINDS: tuple[Kind, ...] = ("suspicious", "read", "ignored", "repaired", "assumed")

# Elements of other programs in words; the others by their tags.
_FOREIGN = {
    "transmission": "transmissions (rotor inertia and gearing are not modelled from them)",
    "gazebo": "<gazebo> blocks (their damping, friction and contact values too)",
    "sensor": "sensors",
    "safety_controller": "safety controllers (they limit velocity and effort)",
    "calibration": "calibrations",
    "contact": "contact coefficients",
    "contact_coefficients": "contact coefficients",
    "self_collision_checking": "self-collision marks",
}


@dataclass(frozen=True)
class Finding:
    """One statement of the report: its kind, what it says, the links, joints or files it is about, and the rule of
    `twolink lint` that says the same.
    """

    kind: Kind
    what: str
    names: tuple[str, ...] = ()
    rule: str = ""

    def __str__(self) -> str:
        if not self.names:
            return self.what
        shown = ", ".join(self.names[:6]) + (f", ... ({len(self.names)} in all)" if len(self.names) > 6 else "")
        return f"{self.what}: {shown}"


@dataclass(frozen=True, repr=False)
class LoadReport:
    """Findings of loading a robot: what is suspicious, and what was read, ignored, repaired and assumed.

    It prints as a list by kind.

    Attributes
    ----------
    source : str
        The file's name, or "URDF text".
    findings : tuple of Finding
        The statements; `suspicious`, `read`, `ignored`, `repaired` and `assumed` give those of one kind.
    """

    source: str
    findings: tuple[Finding, ...]

    @property
    def suspicious(self) -> tuple[Finding, ...]:
        """Findings on values used as they are though they look wrong: units, masses and inertias out of proportion."""
        return self._of("suspicious")

    @property
    def read(self) -> tuple[Finding, ...]:
        """Findings on what was read and is used."""
        return self._of("read")

    @property
    def ignored(self) -> tuple[Finding, ...]:
        """Findings on contents of the URDF without effect on the answers."""
        return self._of("ignored")

    @property
    def repaired(self) -> tuple[Finding, ...]:
        """Findings on errors of the file that have been corrected."""
        return self._of("repaired")

    @property
    def assumed(self) -> tuple[Finding, ...]:
        """Findings on what the URDF leaves out, or says in an unusual way, with the value that is used."""
        return self._of("assumed")

    def _of(self, kind: Kind) -> tuple[Finding, ...]:
        return tuple(f for f in self.findings if f.kind == kind)

    def to_dict(self) -> dict[str, object]:
        """The report as plain data: source, and for each kind a list of {what, names}."""
        groups: dict[str, object] = {k: [{"what": f.what, "names": list(f.names)} for f in self._of(k)] for k in KINDS}
        return {"source": self.source, **groups}

    def __str__(self) -> str:
        lines = [self.source]
        lines += [f"  suspicious: {finding}" for finding in self.suspicious]
        for kind in KINDS[1:]:
            statements = self._of(kind) or ("nothing",)
            lines.extend(f"  {kind + ':' if i == 0 else '':<10}{f}" for i, f in enumerate(statements))
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        kinds = KINDS if self.suspicious else KINDS[1:]
        return facts_html(self.source, {kind: self._of(kind) or ("nothing",) for kind in kinds})


def findings(kind: Kind, statements: Mapping[str, Iterable[str]]) -> list[Finding]:
    """The statements that are about some links, joints or files; those without names are left out."""
    return [Finding(kind, what, tuple(names)) for what, names in statements.items() if names]


def summary(tree: Tree, model: pin.Model, size: int) -> Finding:
    """The size of the robot. `size` is the length of the URDF in bytes."""
    kinds = Counter(joint.type for joint in tree.joints)
    joints = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "no joints"
    mass = sum(link.mass for link in tree.links.values())
    what = f"robot {tree.name!r}: {len(tree.links)} links of {mass:.6g} kg, {joints}; "
    return Finding("read", f"{what}nq = {model.nq}, nv = {model.nv} ({size} bytes)")


_NOT_APPLIED = "forward dynamics does not apply it, inverse dynamics with losses=True only"
_DAMPING = f"joint damping (in robot.model.damping; {_NOT_APPLIED})"
_FRICTION = f"joint friction (in robot.model; {_NOT_APPLIED})"
_NO_FRICTION = "friction of joints of several degrees of freedom (not in robot.model, it is not applied)"
_MANY = ("planar", "floating", "spherical")
_OF_FOLLOWERS = "damping and friction of joints that follow others (not in robot.model)"
_LIMITS = "joint limits (in robot.model; forward and inverse dynamics do not enforce them)"
_NO_LIMITS = "limits of joints that turn without end, or of several coordinates (not in robot.model)"
_RATE_LIMITS = "limits of acceleration, deceleration and jerk (not in robot.model either)"
_MERGED = "fixed joints: these links are merged into the body they are fixed to, and stay as frames"
_ALONG_X = "joints without <axis> turn or slide along x"
_HOLLOWS = "hollows of collision meshes (bodies touch at the convex hulls)"
_BESIDE = "what <collision> has beside a shape and its origin"
_LIMIT_OF_0 = "limits without lower or upper: taken as 0"
_EQUAL_LIMITS = "lower and upper limits that are equal: taken as no limits"
_NO_LOSSES = "joints without damping and friction: losses=True adds 0 there"


def content_findings(
    tree: Tree, *, mimic: bool, odd_inertias: Sequence[str], unphysical: str, missing: Mapping[str, Sequence[str]],
    said: Sequence[Finding] = (),
) -> list[Finding]:  # fmt: skip
    """Findings on contents of a sound URDF that are ignored, repaired or assumed.

    mimic: mimic joints are coupled. odd_inertias: the links whose inertia no real body has; unphysical: "refuse" where
    the bodies they belong to were checked. missing: by what is said of them, meshes without a file. said: findings
    to begin with; links without <inertial> that they name are not named again.
    """
    moving, links = tree.moving, tree.links.values()
    massless = {name for one in said if one.rule == "no-inertial" for name in one.names}
    mimics = {j.name: j.mimic.joint for j in moving if j.mimic is not None}
    joint_names = {j.name for j in tree.joints}
    apart = [j for j in moving if not (mimic and j.mimic)]
    equal = tuple(j.name for j in moving if j.limits is not None and j.limits[0] == j.limits[1])
    sound = " (the bodies they are fixed to are sound)" if unphysical == "refuse" else ""
    ignored = {
        _DAMPING: [j.name for j in apart if j.damping != 0],
        _FRICTION: [j.name for j in apart if j.friction != 0 and j.type not in _MANY],
        _NO_FRICTION: [j.name for j in apart if j.friction != 0 and j.type in _MANY],
        _OF_FOLLOWERS: [j.name for j in moving if j not in apart and (j.damping != 0 or j.friction != 0)],
        _LIMITS: [j.name for j in moving if j.limits is not None and min(map(abs, j.limits)) < NO_LIMIT],
        _NO_LIMITS: [j.name for j in moving if _has_lost_limits(j)],
        "mimic (these joints move independently; mimic=True couples them)": () if mimic else mimics,
        "mimic of a joint that does not exist": [name for name, target in mimics.items() if target not in joint_names],
        _RATE_LIMITS: [j.name for j in moving if j.rate_limits],
        **_of_collisions({link.name: list(link.element.all("collision")) for link in links}),
        **missing,
    }
    stretched = [j.name for j in moving if j.axis is not None and abs(math.hypot(*j.axis) - 1) > 1e-6]
    assumed = {
        _MERGED: [j.child for j in tree.joints if j.type == "fixed"],
        "links without <inertial> have no mass": [k.name for k in links if not (k.has_inertial or k.name in massless)],
        _ALONG_X: [j.name for j in moving if j.axis is None and j.type not in ("floating", "spherical")],
        _NO_LOSSES: [j.name for j in moving if j.damping == j.friction == 0],
        _LIMIT_OF_0: [j.name for j in moving if j.limits and j.name not in equal and _lacks_limit(j.element)],
        f"inertias that no real body has, taken as they are{sound}": odd_inertias,
    }
    repaired = findings("repaired", {"axes that were not of length 1 are normalised": stretched})
    found = findings("ignored", ignored) + _foreign_findings(tree.foreign) + repaired
    found += [Finding("assumed", _EQUAL_LIMITS, equal, "unreachable-limits")] if equal else []
    return [*said, *found, *findings("assumed", assumed)]


def _of_collisions(collisions: Mapping[str, Sequence[Element]]) -> dict[str, list[str]]:
    """Links with <collision> elements, by the statement made of them."""

    def meshed(body: Element) -> bool:
        return any(geometry.first("mesh") is not None for geometry in body.all("geometry"))

    def holds_more(body: Element) -> bool:
        return not {child.tag for child in body.children} <= {"origin", "geometry"}

    every = collisions.items()
    return {
        "collision shapes (bodies touch by effects.Contact)": [link for link, found in every if found],
        _HOLLOWS: [link for link, found in every if any(map(meshed, found))],
        _BESIDE: [link for link, found in every if any(map(holds_more, found))],
    }


def _has_lost_limits(joint: UrdfJoint) -> bool:
    """True if the file limits a coordinate that has no limits; those of effort and velocity stay in one coordinate."""
    limit, keys = joint.element.first("limit"), ("lower", "upper", *["effort", "velocity"] * (joint.type in _MANY))
    return joint.limits is None and limit is not None and any(float(limit.attributes.get(key, "0")) for key in keys)


def _lacks_limit(joint: Element) -> bool:
    """True if a joint's <limit> leaves out the lower or the upper limit."""
    limit = joint.first("limit")
    return limit is not None and not {"lower", "upper"} <= limit.attributes.keys()


def choice_findings(
    tree: Tree, *, root: str, usual_root: str | None, gravity: np.ndarray, locked: Sequence[str], beyond: Sequence[str]
) -> list[Finding]:
    """Findings on the arguments of `load_robot`. `beyond`: the joints that are locked beyond their limits."""
    base = tree.links[tree.root]
    fixed_mass = f", its {base.mass:g} kg do not move" if base.mass > 0 else ""
    place = f"is fixed to the world{fixed_mass}" if root == "fixed" else "moves freely (joint 'root_joint')"
    statements = [
        Finding("assumed", f"link {tree.root!r} {place}"),
        Finding("assumed", f"gravity ({gravity[0]:g}, {gravity[1]:g}, {gravity[2]:g}) m/s^2"),
        *findings("assumed", {"locked joints: merged as if they were fixed": locked}),
        *findings("assumed", {"joints locked beyond their limits": beyond}),
    ]
    if locked:
        statements.append(Finding("ignored", "friction, damping and limits of locked joints"))
    if usual_root == "free" and root == "fixed":
        statements.append(Finding("assumed", 'this robot is meant to move about; root="free" frees its base'))
    return statements


def _foreign_findings(foreign: Foreign) -> list[Finding]:
    """Findings on contents that belong to other programs."""
    elements: Counter[str] = Counter()
    for tag, count in foreign.elements.items():
        elements[_FOREIGN.get(tag, f"<{tag}>")] += count
    named = {
        "values of other programs that change the motion there (effects of a scene can model them)": foreign.motion,
        "attributes of other programs": foreign.attributes,
        'unknown names, left out (foreign="report")': foreign.unknown,
        "text": foreign.text,
        'xacro, left out with all that it holds (xacro="ignore")': foreign.xacro,
    }
    counted = {what: [f"{count} x {name}" for name, count in names.items()] for what, names in named.items()}
    return [Finding("ignored", f"{count} x {what}") for what, count in elements.items()] + findings("ignored", counted)
