"""check_equations: equations that somebody derived beside Pinocchio's, entry by entry, with what mends them.

M and h are compared at random states. The bias is taken apart by asking it for chosen speeds: gravity is h(q, 0), and
the products of speeds are what unit speeds add to it. Where an entry or a part is a constant multiple of the right
one, the multiple is the remedy.
"""

import itertools
import os
import traceback
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.queries import Array
from twolink.errors import QueryError
from twolink.io.text import Table
from twolink.lagrange.equation_coordinates import CoordinateChange, coordinate_changes
from twolink.simulation.text import BaseResult

# Relative: of M[i,k] to s_i s_k, where s_i^2 is the largest M[i,i]; of h[i] to s_i times the largest h[k] / s_k. So
# units do not matter, nor does a heavy joint beside a light one. Equations with all digits typed agree to 1e-13.
LIMIT = 1e-9
ROUNDED = 1e-4  # within it, numbers of few digits are to blame, such as rpy="3.1416 0 0" in a robot's file
STATES, SEED, SPEED = 20, 0, 3.0
Parts = dict[str, Array]
_SPEEDS = "the velocity terms"


class Mend(NamedTuple):
    """The remedy of an entry: factors by what they multiply, in words, and whether it is all that is wanted.

    rounded: whether only rounded numbers are to blame.
    """

    factors: dict[str, float]
    words: str
    mended: bool
    rounded: bool = False


_NO_MEND = Mend({}, "", False)


@dataclass(frozen=True)
class EntryCheck:
    """One entry of M or h: its largest difference and the largest right value over the states, and what mends it.

    mend: in words; "" where the entry is right. factors: by what they multiply ("" is the whole entry, "the gravity
    term", "the velocity terms", "the term of v[0] v[1]"); 0 for what must go. mended: True where they, or the constant
    that `mend` names, make the entry right; but for rounded numbers, where `mend` says so. rounded: True where it is
    right but for them: it does not count as right.
    """

    entry: str
    difference: float
    size: float
    right: bool
    mend: str
    factors: Mapping[str, float]
    mended: bool
    rounded: bool = False


@dataclass(frozen=True, repr=False)
class EquationCheck(BaseResult):
    """Equations of motion beside Pinocchio's.

    Attributes
    ----------
    robot : str
        The robot's name.
    coordinates : str
        The coordinates x of the equations, in words and as q of x.
    found : bool
        Whether the coordinates were found, not given.
    states : int
        The number of random states.
    entries : tuple of EntryCheck
        M[0,0], M[0,1], ..., then h[0], h[1], ...
    """

    robot: str
    coordinates: str
    found: bool
    states: int
    entries: tuple[EntryCheck, ...]

    @property
    def right(self) -> bool:
        """True if every entry is right."""
        return not self.wrong

    @property
    def wrong(self) -> tuple[EntryCheck, ...]:
        """The entries that are wrong."""
        return tuple(entry for entry in self.entries if not entry.right)

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data, and right."""
        return {"right": self.right, **super().to_dict()}

    def __str__(self) -> str:
        rows = [(e.entry, f"{e.difference:.2g}", f"{e.size:.4g}",
                 "right" if e.right else e.mend if e.rounded else f"WRONG: {e.mend}")
                for e in self.entries]  # fmt: skip
        wrong, rounded = ([e.entry for e in self.wrong if e.rounded is which] for which in (False, True))
        verdict = f"{', '.join(wrong)} {'is' if len(wrong) == 1 else 'are'} wrong"
        if not wrong:
            but = f", but for rounded numbers in {', '.join(rounded)}" if rounded else ""
            verdict = f"the equations are right{but}"
        return f"""{self.robot}: {verdict}, at {self.states} random states beside Pinocchio (limit {LIMIT:g}, relative)
Your coordinates{" (found)" if self.found else ""}: {self.coordinates}

{Table(("entry", "largest difference", "largest value", ""), tuple(rows))}"""

    __repr__ = __str__


def check_equations(
    M: Callable[[Array], ArrayLike],  # the names of the formula
    h: Callable[[Array, Array], ArrayLike],
    robot: Robot | str | os.PathLike[str],
    to: str | Iterable[str] | ArrayLike | None = None,
) -> EquationCheck:
    """Compare equations of motion M(x) a + h(x, v) = tau of your own with Pinocchio's, entry by entry.

    Parameters
    ----------
    M : callable
        M(x) -> (nv, nv) [kg m^2, kg], the mass matrix for coordinates x (nv,) [rad, m]; one state a call.
    h : callable
        h(x, v) -> (nv,) [N m, N], the bias: Coriolis, centrifugal and gravity terms, for rates v (nv,) of x.
    robot : Robot, str or path
        A robot whose joints have one degree of freedom each, or what `load_robot` takes.
    to : str, iterable of str or array_like, optional
        The coordinates x. A matrix T (nv, nv) with q = T x, or (T c), (nv, nv + 1), with q = T x + c. Or names, of
        planar chains: "absolute" (angles from one direction, not from the link before), "vertical" (from a vertical,
        where the robot counts from the horizontal; "hanging" is the downward one, "upright" the upward one),
        "absolute vertical"; "own": the robot's. None: the one of these in which the fewest entries are wrong.

    Returns
    -------
    EquationCheck
        `right`, the largest difference of each entry over 20 random states of a fixed seed, and what mends it.

    Raises
    ------
    QueryError
        M or h raises, or gives another shape or what is not finite; `to` fits nothing; the robot has joints of more
        degrees of freedom, or was loaded with mimic=True.

    Notes
    -----
    Pinocchio's equations in x are T^T M T and T^T h: those of Lagrange, whose torques belong to x. Equations from the
    downward vertical with the wrong sign of gravity are right from the upward one: name the one that is meant.
    """
    loaded = robot if isinstance(robot, Robot) else load_robot(robot)
    _require_angles(loaded)
    changes, nv, random = coordinate_changes(loaded, to), loaded.nv, np.random.default_rng(SEED)
    x, v = random.uniform(-np.pi, np.pi, (STATES, nv)), random.uniform(-SPEED, SPEED, (STATES, nv))

    def bias(speeds: Array) -> Array:
        return np.array([_asked("h", h, (nv,), *state) for state in zip(x, speeds, strict=True)])

    mass = np.array([_asked("M", M, (nv, nv), row) for row in x])
    whole, parts = bias(v), _parts(bias, nv)
    checks = []
    for change in changes:
        right = change.mass_matrix(loaded, x)
        sizes = np.sqrt(np.diagonal(right, axis1=1, axis2=2).max(axis=0))
        sizes[sizes == 0.0] = 1.0  # of what moves no mass
        of_mass, of_bias = _mass_checks(mass, right, sizes), _bias_checks(change, loaded, (x, v), whole, parts, sizes)
        words = f"{change.words}; the robot has {change.formula}"
        checks.append(EquationCheck(loaded.name, words, len(changes) > 1, STATES, (*of_mass, *of_bias)))
    return min(checks, key=lambda one: (len(one.wrong), sum(not entry.mended for entry in one.wrong)))


def _require_angles(robot: Robot) -> None:
    """Require joints of one degree of freedom each, none of which follows another."""
    if robot.has_mimic:
        what, remedy = "it has coupled joints", "load it with mimic=False"
        raise QueryError(what, argument="robot", remedy=remedy, code="mimic-joints")
    wide = [joint for joint in robot.joints if joint.v.stop - joint.v.start != 1]
    if wide:
        what = f"its joint {wide[0].name!r} has {wide[0].v.stop - wide[0].v.start} degrees of freedom, expected 1"
        raise QueryError(what, argument="robot", remedy='load it with root="fixed", or lock the joint')


def _asked(name: str, function: Callable[..., ArrayLike], shape: tuple[int, ...], *state: Array) -> Array:
    """The answer of M or h for one state. Raises QueryError."""
    at = ", ".join(f"{x} = {np.round(value, 6).tolist()}" for x, value in zip(("q", "v"), state, strict=False))
    call = {"M": "M(q) -> (nv, nv)", "h": "h(q, v) -> (nv,)"}[name]
    if not callable(function):
        raise QueryError(f"expected a function, got {function!r:.60}", argument=name, remedy=f"define {call}")
    try:
        value = function(*(part.copy() for part in state))
    except Exception as error:  # of any type: it is not ours
        what = f"{raised(error)}, at {at}"
        raise QueryError(what, argument=name, remedy=f"it is called as {call}, for one state") from error
    try:
        answer = np.asarray(value)
        answer = answer.astype(np.float64, casting="unsafe" if answer.dtype.kind == "O" else "same_kind")
    except (TypeError, ValueError):
        what = f"expected real numbers of shape {shape}, got {type(value).__name__}, at {at}"
        raise QueryError(what, argument=name, remedy="return a NumPy array of floats") from None
    if answer.shape != shape:
        what = f"expected shape {shape}, got {answer.shape}, at {at}"
        raise QueryError(what, argument=name, remedy=f"return one array: {call}, nv = {shape[0]}")
    if not np.isfinite(answer).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(answer))[0])
        what, remedy = f"expected finite numbers, got {answer[index]} at {list(index)}, at {at}", "check its divisions"
        raise QueryError(what, argument=name, remedy=remedy, code="not-finite")
    return answer


def raised(error: BaseException) -> str:
    """The exception that somebody's code raised, in words, with the line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    line = "" if isinstance(error, SyntaxError) else f" ({os.path.basename(last.filename)}, line {last.lineno})"
    return f"it raised {type(error).__name__}: {error}{line}"


def _parts(bias: Callable[[Array], Array], nv: int) -> Parts:
    """The bias taken apart, (STATES, nv) each: gravity, and what multiplies each product of two speeds."""

    def at(*moving: int) -> Array:
        return bias(np.tile(np.isin(np.arange(nv), moving).astype(float), (STATES, 1)))

    gravity = at()
    squares = [at(j) - gravity for j in range(nv)]
    parts = {"the gravity term": gravity} | {f"the term of v[{j}]^2": square for j, square in enumerate(squares)}
    for j, k in itertools.combinations(range(nv), 2):
        parts[f"the term of v[{j}] v[{k}]"] = at(j, k) - gravity - squares[j] - squares[k]
    return parts


def _summed(parts: Parts, v: Array) -> Array:
    """The bias at speeds v (STATES, nv) by its parts."""
    pairs = itertools.combinations(range(v.shape[1]), 2)
    products = [np.ones(len(v)), *(v.T**2), *(v[:, j] * v[:, k] for j, k in pairs)]
    return np.asarray(sum(part * product[:, None] for part, product in zip(parts.values(), products, strict=True)))


def _mass_checks(ours: Array, right: Array, sizes: Array) -> list[EntryCheck]:
    """The entries of M."""
    limits, checks = LIMIT * np.outer(sizes, sizes), []
    for i, k in np.ndindex(right.shape[1:]):
        mine, truth, limit = ours[:, i, k], right[:, i, k], float(limits[i, k])
        is_right = bool(np.abs(mine - truth).max() <= limit)
        found = _NO_MEND if is_right else _found({"": mine}, {"": truth}, limit)
        if not is_right and not found.mended and float(np.ptp(truth - mine)) <= limit:
            found = Mend({}, f"plus {_number(float(np.mean(truth - mine)))}", True)
        checks.append(_entry(f"M[{i},{k}]", mine, truth, is_right, found))
    return checks


def _bias_checks(
    change: CoordinateChange, robot: Robot, state: tuple[Array, Array], ours: Array, our_parts: Parts, sizes: Array
) -> list[EntryCheck]:
    """The entries of h."""
    x, v = state
    right, parts = change.bias(robot, x, v), _parts(lambda speeds: change.bias(robot, x, speeds), robot.nv)
    gravity = parts["the gravity term"]
    limits = LIMIT * sizes * float(((np.abs(gravity) + np.abs(right - gravity)) / sizes).max() or 1.0)
    of_parts = LIMIT * sizes * max(float((np.abs(part) / sizes).max()) for part in parts.values())
    rest, checks = np.abs(ours - _summed(our_parts, v)), []
    for i, limit in enumerate(limits):
        is_right = bool(np.abs(ours[:, i] - right[:, i]).max() <= limit)
        found = _NO_MEND
        if not is_right and rest[:, i].max() > limit:
            found = Mend({}, "it holds more than gravity and products of two speeds (friction?)", False)
        elif not is_right:
            mine, truth = ({name: part[:, i] for name, part in of.items()} for of in (our_parts, parts))
            found = _found(mine, truth, float(of_parts[i]))
        checks.append(_entry(f"h[{i}]", ours[:, i], right[:, i], is_right, found))
    return checks


def _entry(name: str, ours: Array, right: Array, is_right: bool, found: Mend) -> EntryCheck:
    difference, size = (float(np.abs(value).max()) for value in (ours - right, right))
    return EntryCheck(name, difference, size, is_right, found.words, found.factors, found.mended, found.rounded)


def _found(ours: Parts, right: Parts, limit: float) -> Mend:
    """The remedy of an entry to the limit; where there is none, that which mends it but for rounded numbers."""
    found = _mended(ours, right, limit)
    rough = found if found.mended else _mended(ours, right, limit / LIMIT * ROUNDED)
    if found.mended or not rough.mended:
        return found
    if not rough.words:
        return Mend({}, "right but for rounded numbers, yours or the robot's (3.1416 for pi?)", True, True)
    return rough._replace(words=f"{rough.words}, then right but for rounded numbers")


def _mended(ours: Parts, right: Parts, limit: float) -> Mend:
    """Factors by what they multiply, and in words: of the whole entry, of all velocity terms, or of single parts."""
    there = [name for name in right if max(np.abs(ours[name]).max(), np.abs(right[name]).max()) > limit]
    speeds = [name for name in there if name.startswith("the term")]
    groups = {"": there} if len(there) > 1 or there == [""] else {}
    groups |= {_SPEEDS: speeds} if len(speeds) > 1 and len(speeds) < len(there) else {}
    for group, names in groups.items():
        mine, truth = (np.concatenate([of[name] for name in names]) for of in (ours, right))
        factor = _factor(mine, truth, limit)
        if factor is not None and factor != 1:
            others = [name for name in there if name not in names]
            more = _mended({name: ours[name] for name in others}, {name: right[name] for name in others}, limit)
            words = "; ".join(filter(None, (_said(group, factor), more.words)))
            return Mend({group: factor, **more.factors}, words, more.mended)
    wrong = [name for name in there if float(np.abs(ours[name] - right[name]).max()) > limit]
    found = {name: _factor(ours[name], right[name], limit) for name in wrong}
    factors = {name: factor for name, factor in found.items() if factor is not None}
    said = [_said(name, found[name], float(np.abs(ours[name]).max()) <= limit) for name in wrong]
    return Mend(factors, "; ".join(said), len(factors) == len(wrong))


def _factor(ours: Array, right: Array, limit: float) -> float | None:
    """The f with f * ours = right, to the limit; None where there is none."""
    size = float(np.abs(ours).max())
    if size <= limit:
        return None
    scaled = ours / size
    factor = float(scaled @ right / (scaled @ scaled)) / size
    if float(np.abs(factor * ours - right).max()) > limit:
        return None
    near = float(Fraction(factor).limit_denominator(48))
    return near if float(np.abs((near - factor) * ours).max()) <= limit else factor


def _said(part: str, factor: float | None, missing: bool = False) -> str:
    """A factor in words."""
    if factor is None:
        return f"{part or 'it'} is missing" if missing else f"no constant factor mends {part or 'it'}"
    if factor == 0:
        return f"{part or 'it'} must be 0"
    if part and factor == -1:
        return f"{part} {'have' if part == _SPEEDS else 'has'} the wrong sign"
    return f"{part + ': ' if part else ''}times {_number(factor)}"


def _number(x: float) -> str:
    """A number, as a fraction where it is a simple one."""
    near = Fraction(x).limit_denominator(48)
    return str(near) if abs(float(near) - x) <= 1e-12 * abs(x) else f"{x:.6g}"
