"""Checks of masses, inertias and centres of mass, alone and beside the shapes of their links, and likely causes."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal

import numpy as np

from twolink.parts.lint.findings import Defect, Severity, defect
from twolink.parts.lint.reading import Reading
from twolink.parts.lint.shapes import Extent, placement
from twolink.robots.checks import impossible_bodies, impossible_inertia, is_impossible
from twolink.robots.tree import other_side
from twolink.robots.urdf import UrdfLink
from twolink.robots.xml import Element

SLOTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_DIAGONAL = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_POWERS = (-3, -6, 3, 6, *(k for k in range(-9, 10) if k and k % 3))  # thousands first: of units, and of groups
_UNITS = {3: "g m^2", 4: "kg cm^2", 6: "kg mm^2", 7: "g cm^2", 9: "g mm^2"}
_FEW_DIGITS = 5e-3  # of the largest moment
_GROSS = 0.4  # of the largest moment: less than that is no lost decimal point
_OF_STEINER = 0.3  # how far below 0 a moment is, of the parallel-axis term that explains it
_EVEN = 0.02  # the ratio of moments below which a correction makes a needle of the body
_POINT = 1e-4  # m: a radius of gyration below which a body is a point
_BEYOND, _FAR_BEYOND = 1.25, 2.0  # times the largest moments of the shapes: where the cause is known, and else
_BELOW = 1 / 300  # times the moments of a full box
_LIGHT, _DENSE = 1.0, 25_000.0  # kg/m^3: less than foam, more than osmium
_SMALLEST = 1e-3  # m: half the diagonal of shapes that say something about a body
_APART, _DIFFERENT = 1e-3, 0.05  # of both sides of a mirrored pair: a note, a warning
_BOTH = ("visual", "collision")
_TEMPLATE = 0.1  # kg m^2: a power of ten from here on is a template's, with a mass that does not go with it


def inertial(link: UrdfLink) -> Element | None:
    """The <inertial> of a link that was read; None where it has none, or a wrong one."""
    element = link.element.first("inertial")
    return None if element is None or "unread" in element.attributes else element


def _bodies(reading: Reading) -> Iterator[tuple[UrdfLink, Element, np.ndarray]]:
    """The links with an <inertial>, it, and their centres of mass."""
    for link in reading.links.values():
        if (part := inertial(link)) is not None:
            yield link, part, placement(part).translation


def impossible(reading: Reading) -> Iterator[Defect]:
    """Inertias that no body has; a warning where the body that the link is fixed to is sound."""
    whole = reading.tree is not None and reading.model is not None
    to_blame = [link.name for link in impossible_bodies(reading.tree, reading.model)] if whole else []  # type: ignore[arg-type]
    for link, part, centre in _bodies(reading):
        if is_impossible(link.inertia, link.mass):
            element = part.first("inertia")
            given = element.attributes if element else {}
            numbers = {key: float(given[key]) for key in given if key in SLOTS}
            cause = cause_of_impossible(numbers, link.mass, placement(part).rotation.T @ centre)
            certain = (link.name in to_blame or not whole) and not cause.startswith("likely rounding")
            severity: Severity = "error" if certain or link.name in to_blame else "warning"
            yield defect("impossible-inertia", link.name, reading.line(element, link.name),
                         impossible_inertia(link).what, cause, severity=severity)  # fmt: skip


def written_inertias(mujoco: Element) -> Iterator[Defect]:
    """Inertias of an MJCF, as they stand in it, that no body has."""
    for body in mujoco.inside():
        for part in body.all("inertial") if body.tag == "body" else ():
            keys = ("mass", "pos", "diaginertia", "fullinertia")
            written = {key: part.attributes.get(key, "").split() for key in keys}
            try:
                mass, *centre = map(float, written["mass"] + written["pos"])
                full = list(map(float, written["diaginertia"] + written["fullinertia"]))
            except ValueError:
                continue
            six = dict(zip(_DIAGONAL, [*full, *[0.0] * (6 - len(full))], strict=False))
            if full and is_impossible(matrix(six), mass):
                yield defect("impossible-inertia", body.attributes.get("name", ""), part.line,
                             f"principal moments ({_listed(np.linalg.eigvalsh(matrix(six)))}) kg m^2",
                             cause_of_impossible(six, mass, np.resize(centre, 3)))  # fmt: skip


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
    lumped = {parent for parent, child in fixed if child.mass == 0 and reading.shapes.extent(child.element, _BOTH)}
    for link, part, centre in _bodies(reading):
        found = reading.shapes.extent(link.element, _BOTH)
        if link.mass <= 0 or found.half_diagonal < _SMALLEST or not found.whole:
            continue
        line = reading.line(part, link.name)
        solids = [reading.shapes.extent(link.element, (tag,)) for tag in _BOTH]
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


def mirrored_bodies(reading: Reading) -> Iterator[Defect]:
    """Links that have another mass or other moments than their counterpart on the other side."""
    for name, link in reading.links.items():
        other = reading.links.get(other_side(name))
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


def matrix(six: Mapping[str, float]) -> np.ndarray:
    """The inertia matrix (3, 3) of six numbers by name."""
    xx, xy, xz, yy, yz, zz = (six[name] for name in SLOTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def steiner(mass: float, centre: np.ndarray) -> np.ndarray:
    """The difference of the inertia about the origin and about the centre of mass, m (c^2 E - c c^T)."""
    return np.asarray(mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))


def cause_of_impossible(six: Mapping[str, float], mass: float, centre: np.ndarray) -> str:
    """The likely cause of an inertia that no body has. six: in the order of the file. centre (3,): in its axes."""
    if mass <= 0:
        return "give its mass, or moments of 0"

    def sound(changed: np.ndarray) -> bool:
        moments = np.linalg.eigvalsh(changed)
        return not is_impossible(changed, mass) and bool(moments[0] > _EVEN * moments[-1])

    given = matrix(six)
    causes = [_few_digits(six), _rows(six), *_orders(six, sound), _about_another_point(given, mass, centre),
              _negative(six, mass), *_points(six, sound), _signs(six, mass)]  # fmt: skip
    return next(filter(None, causes), "")


def cause_of_size(inertia: np.ndarray, mass: float, centre: np.ndarray, largest: np.ndarray, typical: float) -> str:
    """The likely cause of moments that do not fit the size.

    largest (3,): the largest moments about the axes that the shapes allow, kg m^2; typical: of a full box, the mean.
    """
    central = inertia - steiner(mass, centre)
    if not is_impossible(central, mass) and (np.diag(central) <= largest).all() and (np.diag(inertia) > largest).any():
        shown = ", ".join(f"{x:.4g}" for x in np.diag(central))
        return f"it is likely about the link's origin, not the centre of mass, where the moments are ({shown})"
    ratio = float(np.trace(inertia)) / 3 / typical
    power = round(math.log10(ratio)) if ratio > 0 else 0
    unit = next((name for k, name in _UNITS.items() if abs(power - k) <= (0 if k in (4, 7) else 1)), "")
    if unit:
        return f"the moments are about 1e{power} times those of a full box: likely in {unit}; give kg m^2"
    if mass > 0 and (power >= 2 or power <= -2):
        return f"the moments are about 1e{power} times those of a full box: a lost decimal point, or the mass is wrong"
    return ""


def _few_digits(six: Mapping[str, float]) -> str:
    """Rounding: half a unit of the last digits, or of the third one, makes up for what is wrong."""
    i1, i2, i3 = np.linalg.eigvalsh(matrix(six))
    last = sum(0.5 * 10.0 ** int(Decimal(repr(x)).normalize().as_tuple().exponent) for x in six.values() if x)
    allowed = max(min(last, 0.1 * i3), _FEW_DIGITS * i3)
    return "likely rounding: give more digits" if i3 > 0 and max(-i1, i3 - i1 - i2) < allowed else ""


def _rows(six: Mapping[str, float]) -> str:
    """Nine entries row by row: xx xy xz yx yy yz in the places of xx xy xz yy yz zz, so that iyy repeats ixy."""
    if six["iyy"] == six["ixy"] != 0 and six["iyz"] > 0:
        return (f"likely nine entries in row-major order in the places of six: iyy repeats ixy, so iyy is "
                f"{six['iyz']:g} and iyz is {six['izz']:g}")  # fmt: skip
    return ""


def _orders(six: Mapping[str, float], sound: Callable[[np.ndarray], bool]) -> Iterator[str]:
    """The six numbers in another order: the diagonal first, or row by row."""
    words = {_DIAGONAL: "the diagonal first, in the places of row-major order",
             SLOTS: "in row-major order, in the places of the diagonal first"}  # fmt: skip
    for meant, places in ((_DIAGONAL, SLOTS), (SLOTS, _DIAGONAL)):
        moved = {name: six[place] for name, place in zip(meant, places, strict=True)}
        products = [abs(moved[name]) for name in ("ixy", "ixz", "iyz")]
        if sound(matrix(moved)) and max(products) <= 0.5 * max(moved["ixx"], moved["iyy"]):
            yield f"likely the six numbers are {words[meant]}: {', '.join(f'{k}={v:g}' for k, v in moved.items())}"


def _negative(six: Mapping[str, float], mass: float) -> str:
    wrong = [name for name in ("ixx", "iyy", "izz") if six[name] < 0]
    flipped = {name: -six[name] if name in wrong else six[name] for name in SLOTS}
    if wrong and not is_impossible(matrix(flipped), mass):
        return f"likely a lost sign: {', '.join(f'{name}={flipped[name]:g}' for name in wrong)} would be a body's"
    return ""


def _points(six: Mapping[str, float], sound: Callable[[np.ndarray], bool]) -> Iterator[str]:
    """The one number that a power of ten makes possible; of several powers, those of the most even moments first."""
    i1, i2, i3 = np.linalg.eigvalsh(matrix(six))
    if max(-i1, i3 - i1 - i2) < _GROSS * max(i3, -i1):
        return
    found = []
    for name, power in itertools.product(SLOTS, _POWERS):
        changed = {**six, name: six[name] * 10.0**power}
        if six[name] and sound(matrix(changed)):
            moments = np.linalg.eigvalsh(matrix(changed))
            found.append((moments[-1] / moments[0], name, changed[name]))
    if len({name for _, name, _ in found}) == 1:
        values = " or ".join(f'{name}="{value:g}"' for _, name, value in sorted(found)[:3])
        yield f"likely a lost decimal point: {values} would be a body's"


def _signs(six: Mapping[str, float], mass: float) -> str:
    if not is_impossible(matrix({**six, "ixy": -six["ixy"]}), mass):  # any of the three has the same moments
        return "likely the sign of ixy, ixz or iyz: CAD programs often give products of inertia with the other sign"
    return ""


def _about_another_point(given: np.ndarray, mass: float, centre: np.ndarray) -> str:
    moved = steiner(mass, centre)
    by_as_much = -np.linalg.eigvalsh(given)[0] > _OF_STEINER * np.trace(moved) / 2
    if by_as_much and not is_impossible(given + moved, mass):
        return "likely about the wrong point: the parallel-axis term of the centre of mass was taken off once too often"
    return ""
