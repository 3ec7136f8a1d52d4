"""Why two inertias differ, in words: what converters and people get wrong; and limbs that are not each other's mirror
image for one wrong sign, which no check of a single body shows.
"""

import itertools
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from twolink.robots.tree import Tree, other_side
from twolink.robots.urdf import UrdfLink

ENTRIES = {"ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
_MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class LinkInertia:
    """A link's mass [kg], centre of mass (3,) [m], and inertia (3, 3) [kg m^2] about it, along the link's axes.

    turn: the rotation of <inertial><origin rpy>, the identity where there is none.
    """

    mass: float
    centre: np.ndarray
    inertia: np.ndarray
    turn: np.ndarray

    @property
    def at_origin(self) -> np.ndarray:
        """The inertia about the link's origin."""
        c = self.centre
        return np.asarray(self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def link_inertia(link: UrdfLink) -> LinkInertia:
    """The inertia of a link as its URDF states it."""
    inertial = link.element.first("inertial")
    origin = None if inertial is None else inertial.first("origin")
    xyz, rpy = (([float(x) for x in origin.attributes.get(key, "0 0 0").split()] if origin else [0.0] * 3)
                for key in ("xyz", "rpy"))  # fmt: skip
    return LinkInertia(link.mass, np.array(xyz), link.inertia, np.asarray(pin.rpy.rpyToMatrix(*rpy)))


def centre_cause(a: LinkInertia, b: LinkInertia, near: float) -> str:
    """Why the centre of mass of b is not that of a; near: m, within which they are one."""
    same = partial(np.allclose, rtol=0.0, atol=near)
    for origin, other in (("b", b), ("a", a)):
        if same(other.centre, np.zeros(3)):
            return f"it is at the link's origin in {origin}: the centre of mass was left out"
    for k, axis in enumerate("xyz"):
        flipped = a.centre.copy()
        flipped[k] *= -1
        if same(flipped, b.centre):
            return f"the sign of {axis}"
    if same(-a.centre, b.centre):
        return "the sign of all coordinates"
    for factor, words in ((1e3, "millimetres for metres"), (1e-3, "metres for millimetres")):
        if same(a.centre * factor, b.centre):
            return words
    return f"moved by {np.linalg.norm(b.centre - a.centre):.4g} m"


def inertia_cause(a: LinkInertia, b: LinkInertia, near: float) -> tuple[str, str]:
    """Why the inertia of b is not that of a, and the attribute at fault. near: kg m^2, within which they are one."""
    same = partial(np.allclose, rtol=0.0, atol=near)
    for first, second, who in ((a, b, "b"), (b, a, "a")):
        if same(first.turn.T @ first.inertia @ first.turn, second.inertia):
            return f"the rotation of the inertia is left out in {who}", "<inertial><origin rpy>"
        if same(first.at_origin, second.inertia):
            return f"in {who} it is about the link's origin, not about the centre of mass", "<inertial><inertia>"
    for count in (1, 2, 3):
        for names in itertools.combinations(ENTRIES, count):
            flipped = a.inertia.copy()
            for i, j in (ENTRIES[name] for name in names):
                flipped[i, j] = flipped[j, i] = -flipped[i, j]
            if same(flipped, b.inertia):
                return f"the sign of {', '.join(names)}", f"<inertial><inertia {' '.join(names)}>"
    off = ~np.eye(3, dtype=bool)
    if same(np.where(off, 0.0, a.inertia), b.inertia):
        return "the products of inertia are left out in b", "<inertial><inertia ixy ixz iyz>"
    ratio = float(np.vdot(a.inertia, b.inertia) / max(np.vdot(a.inertia, a.inertia), 1e-300))
    if ratio > 0 and same(a.inertia * ratio, b.inertia):
        also = ", as the mass" if abs(b.mass / (a.mass or np.inf) - ratio) < 1e-6 * ratio else ""
        return f"scaled by {ratio:.6g}{also}", "<inertial><inertia>"
    if same(np.linalg.eigvalsh(a.inertia), np.linalg.eigvalsh(b.inertia)):
        return "rotated: the principal moments are equal, their axes are not", "<inertial><origin rpy>"
    entries = [np.sort(np.abs(x[np.triu_indices(3)])) for x in (a.inertia, b.inertia)]
    if same(*entries):
        return "the same numbers in another order", "<inertial><inertia>"
    return f"it differs by {np.abs(b.inertia - a.inertia).max():.3g} kg m^2", "<inertial><inertia>"


def mirror_faults(tree: Tree, model: pin.Model, tolerance: float) -> list[str]:
    """The limbs that one sign keeps from being each other's mirror image, left and right of y = 0 at zero."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    poses = {f.name: data.oMf[k] for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
    links = {name: link_inertia(link) for name, link in tree.links.items() if link.mass > 0 and name in poses}
    found = []
    for left, right in ((name, other) for name in links if (other := other_side(name)) in links):
        a, b = links[left], links[right]
        near = tolerance * max(np.abs(a.inertia).max(), np.abs(b.inertia).max())
        wanted = _MIRROR @ poses[left].rotation @ a.inertia @ poses[left].rotation.T @ _MIRROR
        turn = poses[right].rotation
        missing = np.abs(turn.T @ wanted @ turn - b.inertia)
        for entry, (i, j) in ENTRIES.items():
            rest = missing.copy()
            rest[i, j] = rest[j, i] = 0.0
            flips = abs((turn.T @ wanted @ turn)[i, j] + b.inertia[i, j]) <= near < missing[i, j]
            if flips and rest.max() <= near:
                found.append(f"{left} and {right} would mirror each other but for the sign of {entry}")
    return found
