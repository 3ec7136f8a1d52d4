"""Likely causes of moments of inertia that no body has, or that do not fit its size."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from decimal import Decimal

import numpy as np

from twolink.robots.checks import is_impossible

SLOTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_DIAGONAL = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_POWERS = (-3, -6, 3, 6, *(k for k in range(-9, 10) if k and k % 3))  # thousands first: of units, and of groups
_UNITS = {3: "g m^2", 4: "kg cm^2", 6: "kg mm^2", 7: "g cm^2", 9: "g mm^2"}
_FEW_DIGITS = 5e-3  # of the largest moment
_GROSS = 0.4  # of the largest moment: less than that is no lost decimal point
_OF_STEINER = 0.3  # how far below 0 a moment is, of the parallel-axis term that explains it
_EVEN = 0.02  # the ratio of moments below which a correction makes a needle of the body


def matrix(six: Mapping[str, float]) -> np.ndarray:
    """The inertia matrix (3, 3) of six numbers by name."""
    xx, xy, xz, yy, yz, zz = (six[name] for name in SLOTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def steiner(mass: float, centre: np.ndarray) -> np.ndarray:
    """The difference of the inertia about the origin and about the centre of mass, m (c^2 E - c c^T)."""
    return np.asarray(mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))


def cause_of_impossible(six: Mapping[str, float], mass: float, centre: np.ndarray) -> str:
    """The likely cause of an inertia that no body has. six: in the order of the file. centre (3,): in its axes."""

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


def _orders(six: Mapping[str, float], sound: object) -> Iterator[str]:
    """The six numbers in another order: the diagonal first, or row by row."""
    words = {_DIAGONAL: "the diagonal first, in the places of row-major order",
             SLOTS: "in row-major order, in the places of the diagonal first"}  # fmt: skip
    for meant, places in ((_DIAGONAL, SLOTS), (SLOTS, _DIAGONAL)):
        moved = {name: six[place] for name, place in zip(meant, places, strict=True)}
        products = [abs(moved[name]) for name in ("ixy", "ixz", "iyz")]
        if callable(sound) and sound(matrix(moved)) and max(products) <= 0.5 * max(moved["ixx"], moved["iyy"]):
            yield f"likely the six numbers are {words[meant]}: {', '.join(f'{k}={v:g}' for k, v in moved.items())}"


def _negative(six: Mapping[str, float], mass: float) -> str:
    wrong = [name for name in ("ixx", "iyy", "izz") if six[name] < 0]
    flipped = {name: -six[name] if name in wrong else six[name] for name in SLOTS}
    if wrong and not is_impossible(matrix(flipped), mass):
        return f"likely a lost sign: {', '.join(f'{name}={flipped[name]:g}' for name in wrong)} would be a body's"
    return ""


def _points(six: Mapping[str, float], sound: object) -> Iterator[str]:
    """The one number that a power of ten makes possible; of several powers, those of the most even moments first."""
    i1, i2, i3 = np.linalg.eigvalsh(matrix(six))
    if max(-i1, i3 - i1 - i2) < _GROSS * max(i3, -i1):
        return
    found = []
    for name, power in itertools.product(SLOTS, _POWERS):
        changed = {**six, name: six[name] * 10.0**power}
        if six[name] and callable(sound) and sound(matrix(changed)):
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
