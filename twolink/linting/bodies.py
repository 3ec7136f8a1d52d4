"""Checks of masses, inertias and centres of mass, alone and beside the shapes of their links."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from twolink.linting.causes import SLOTS, cause_of_impossible, cause_of_size
from twolink.linting.findings import Defect, Severity, defect
from twolink.linting.reading import Reading
from twolink.linting.shapes import Extent, extent
from twolink.robots.checks import impossible_bodies, impossible_inertia, is_impossible
from twolink.robots.urdf import UrdfLink
from twolink.robots.xml import Element

_POINT = 1e-4  # m: a radius of gyration below which a body is a point
_BEYOND, _FAR_BEYOND = 1.25, 2.0  # times the largest moments of the shapes: where the cause is known, and else
_BELOW = 1 / 300  # times the moments of a full box
_LIGHT, _DENSE = 1.0, 25_000.0  # kg/m^3: less than foam, more than osmium
_SMALLEST = 1e-3  # m: half the diagonal of shapes that say something about a body
_APART, _DIFFERENT = 1e-3, 0.05  # of both sides of a mirrored pair: a note, a warning
_BOTH = ("visual", "collision")
_TEMPLATE = 0.1  # kg m^2: a power of ten from here on is a template's, with a mass that does not go with it
_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R"), ("FL", "FR"), ("RL", "RR"),
          ("HL", "HR"), ("LF", "RF"), ("LH", "RH"), ("LR", "RR"), ("fl", "fr"), ("rl", "rr"), ("lf", "rf"),
          ("lh", "rh"))  # fmt: skip


def inertial(link: UrdfLink) -> Element | None:
    """The <inertial> of a link that was read; None where it has none, or a wrong one."""
    element = link.element.first("inertial")
    return None if element is None or "unread" in element.attributes else element


def _bodies(reading: Reading) -> Iterator[tuple[UrdfLink, Element, np.ndarray]]:
    """The links with an <inertial>, it, and their centres of mass."""
    for link in reading.links.values():
        if (part := inertial(link)) is not None:
            origin = part.first("origin")
            text = origin.attributes.get("xyz", "0 0 0") if origin else "0 0 0"
            yield link, part, np.array(text.split(), dtype=float)


def impossible(reading: Reading) -> Iterator[Defect]:
    """Inertias that no body has; a warning where the body that the link is fixed to is sound."""
    whole = reading.tree is not None and reading.model is not None
    to_blame = [link.name for link in impossible_bodies(reading.tree, reading.model)] if whole else []  # type: ignore[arg-type]
    for link, part, centre in _bodies(reading):
        if is_impossible(link.inertia, link.mass):
            element, origin = part.first("inertia"), part.first("origin")
            given = element.attributes if element else {}
            numbers = {key: float(given[key]) for key in given if key in SLOTS}
            angles = (origin.attributes.get("rpy", "0 0 0") if origin else "0 0 0").split()
            cause = cause_of_impossible(numbers, link.mass, pin.rpy.rpyToMatrix(*map(float, angles)).T @ centre)
            certain = (link.name in to_blame or not whole) and not cause.startswith("likely rounding")
            severity: Severity = "error" if certain or link.name in to_blame else "warning"
            yield defect("impossible-inertia", link.name, reading.line(element, link.name),
                         impossible_inertia(link).what, cause, severity=severity)  # fmt: skip


def without_inertia(reading: Reading) -> Iterator[Defect]:
    """Masses of 0 with a shape that collides, moments of 0 with a mass, and those of templates."""
    for link, part, _ in _bodies(reading):
        line = reading.line(part, link.name)
        if link.mass == 0 and link.element.first("collision"):
            yield defect("zero-mass", link.name, line, "mass 0, but it can collide", "give its mass")
        moments, least = np.diag(link.inertia), link.mass * _POINT**2
        if np.abs(link.inertia).max() < least:
            yield defect("zero-inertia", link.name, line, f"moments ({_listed(moments)}) kg m^2 of {link.mass:g} kg",
                         "give those of the body; a full box has m (a^2 + b^2) / 12")  # fmt: skip
        power = np.log10(moments[0]) if moments[0] >= _TEMPLATE else 0.5
        if (link.inertia == moments[0] * np.eye(3)).all() and power.is_integer():
            yield defect("placeholder-inertia", link.name, line, f"all moments are {moments[0]:g} kg m^2",
                         "likely a template's: give those of the body")  # fmt: skip


def beside_shapes(reading: Reading) -> Iterator[Defect]:
    """Mass, moments and centre of mass that do not fit the shapes of the link."""
    if reading.tree is None:
        return
    fixed = [(joint.parent, reading.links[joint.child]) for joint in reading.joints if joint.type == "fixed"]
    lumped = {parent for parent, child in fixed if child.mass == 0 and extent(child.element, reading.folders, _BOTH)}
    for link, part, centre in _bodies(reading):
        found = extent(link.element, reading.folders, _BOTH)
        if link.mass <= 0 or found.half_diagonal < _SMALLEST or not found.whole:
            continue
        line = reading.line(part, link.name)
        solids = [extent(link.element, reading.folders, (tag,)) for tag in _BOTH]
        yield from _density(link, max(solids, key=lambda one: one.volume), line, link.name in lumped)
        if (beside := found.beside(centre)) > max(found.half_diagonal, 0.02):
            scaled = found.beside(centre / 1000) == 0.0 and np.linalg.norm(centre) > 10 * found.half_diagonal
            yield defect("com-shape", link.name, line,
                         f"a centre of mass ({_listed(centre)}) m, {beside:.3g} m beside the shapes",
                         "likely in millimetres: give m" if scaled else "likely of another frame")  # fmt: skip
        elif link.name not in lumped:
            yield from _moments(link, found, centre, line)


def _density(link: UrdfLink, found: Extent, line: int, joined: bool) -> Iterator[Defect]:
    if not found.volume > 0:
        return
    density = link.mass / found.volume
    what = f"{link.mass:g} kg in {1e6 * found.volume:.3g} cm^3 of shapes, {density:.3g} kg/m^3"
    if density > _DENSE and not joined:
        grams = f"likely grams: give kg, {link.mass / 1000:g}" if density / 1000 > 100 and link.mass >= 10 else ""
        yield defect("mass-shape", link.name, line, what, grams or "likely too large a mass, or small a shape")
    elif density < _LIGHT:
        large = 100 < density * 1e9 < _DENSE or found.half_diagonal > 10
        yield defect("mass-shape", link.name, line, what, "likely shapes in millimetres: give m" if large else
                     "likely too small a mass", severity=None if large else "note")  # fmt: skip


def _moments(link: UrdfLink, found: Extent, centre: np.ndarray, line: int) -> Iterator[Defect]:
    largest, moments = link.mass * found.largest_moments(centre), np.diag(link.inertia)
    typical = link.mass * float(np.sum(np.ptp(found.points, axis=0) ** 2)) / 18
    beyond, below = np.max(moments / np.maximum(largest, 1e-300)), np.mean(moments) < _BELOW * typical
    if is_impossible(link.inertia, link.mass) or not np.any(moments) or not (beyond > _BEYOND or below):
        return
    cause = cause_of_size(link.inertia, link.mass, centre, largest, typical)
    if below or beyond > _FAR_BEYOND or "origin" in cause:
        small, large = f"{np.mean(moments) / typical:.1g} times those of a full box", f"{beyond:.3g} times the largest"
        what = f"moments ({_listed(moments)}) kg m^2, {small if below else large} of {link.mass:g} kg within the shapes"
        yield defect("inertia-shape", link.name, line, what, cause)


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in values)


def opposite(name: str) -> str:
    """The name of the right part that a left one has, or ""."""
    for left, right in _SIDES:
        whole = left if len(left) > 2 else rf"(?<![A-Za-z]){left}(?![A-Za-z])"
        changed = re.sub(whole, right, name, count=1)
        if changed != name:
            return changed
    return ""


def mirrored_bodies(reading: Reading) -> Iterator[Defect]:
    """Links that have another mass or other moments than their counterpart on the other side."""
    for name, link in reading.links.items():
        other = reading.links.get(opposite(name))
        if other is None or inertial(link) is None or inertial(other) is None:
            continue
        pairs = {"mass": [np.array([one.mass]) for one in (link, other)],
                 "principal moments": [np.linalg.eigvalsh(one.inertia) for one in (link, other)]}  # fmt: skip
        for what, (ours, theirs) in pairs.items():
            apart, sizes = np.abs(ours - theirs).max(), sorted(np.abs(each).max() for each in (ours, theirs))
            if apart > _APART * sizes[1]:
                shown = f"{what} ({_listed(ours)}) and ({_listed(theirs)}) {'kg' if what == 'mass' else 'kg m^2'}"
                yield _pair(reading, link, other, shown, apart > _DIFFERENT * sizes[1], sizes[0] / sizes[1])


def _pair(reading: Reading, link: UrdfLink, other: UrdfLink, what: str, far: bool, ratio: float) -> Defect:
    power = np.log10(ratio) if ratio > 0 else -np.inf
    cause = "those of one side are missing" if power < -9 else (
        "likely a lost decimal point" if power < -0.9 and abs(power - round(power)) < 0.02 else "")  # fmt: skip
    return defect("mirrored-pair", link.name, reading.line(link.element.first("inertial"), link.name),
                  f"beside {other.name!r}: {what}", cause, severity=None if far else "note")  # fmt: skip
