"""Unknowns of a fit by simulation: names, and coordinates z in which every value is one that can be.

z = 0 is the scene as it is, and a change of z by 1 about as large as the value itself. A mass is m0 exp(z). The ten
parameters of a body, where all of them are looked for, are its log-Cholesky parameters (`consistency`); other
values are linear in z. Derivatives are complex steps (Squire and Trapp 1998).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag

from twolink.algorithms.mechanism import BODY_PARAMETERS, body_names
from twolink.effects import Constants, JointDamping
from twolink.errors import QueryError, SceneError, require_known
from twolink.parts.identification.base_parameters import require_list
from twolink.parts.identification.consistency import central, from_central, log_cholesky_chart, pseudo_inertia, size_of
from twolink.robots.checks import is_impossible
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, named_parameters, parameters_of, scene_with

_STEP = 1e-30
_MARGIN = 1e-5  # of the largest eigenvalue of a pseudo-inertia
_CENTRAL = ("mass", "com.x", "com.y", "com.z",
            "inertia.xx", "inertia.xy", "inertia.xz", "inertia.yy", "inertia.yz", "inertia.zz")  # fmt: skip
ToBody = Callable[[np.ndarray], np.ndarray]
ToCoordinate = Callable[[int, float], float]
Chart = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class _NameGroup:
    """Names that belong together. chart: z -> their values, and the values of the scene's constants behind them.

    constants: their names for `tl.sensitivities`; one name for several values where `joint`, a joint of the state.
    inverse: a value of the name at a place -> its z, which it grows with; None: there are no bounds of them.
    lowest: that it can have. to_body: of a part of a body's parameters, z -> all ten.
    """

    names: tuple[str, ...]
    constants: tuple[str, ...]
    chart: Chart
    of_state: bool = False
    inverse: ToCoordinate | None = None
    to_body: ToBody | None = None
    lowest: float = -np.inf


class Unknowns:
    """The unknowns of a fit of a scene.

    names (k,): as asked for, in SI units. wrt: the names of the derivatives that it takes, in order; of those the first
    `constants` are no initial states.
    """

    def __init__(self, scene: Scene, groups: Sequence[_NameGroup]) -> None:
        ordered = sorted(groups, key=lambda group: group.of_state)
        self.scene, self._groups = scene, ordered
        self.names = tuple(name for group in ordered for name in group.names)
        self.wrt = tuple(name for group in ordered for name in group.constants)
        self.constants = sum(len(group.constants) for group in ordered if not group.of_state)

    def values(self, z: np.ndarray) -> np.ndarray:
        """The values (k,) of the names."""
        return np.concatenate([group.chart(part)[0] for group, part in self._parts(z)])

    def derivatives(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by z of the values (k, k), and of the constants and initial states (., k)."""
        first, second = zip(*(_complex_step(group.chart, part) for group, part in self._parts(z)), strict=True)
        return np.asarray(block_diag(*first)), np.asarray(block_diag(*second))

    def limits(self, bounds: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest z (k,): what the names can have, and bounds by name. Raises QueryError."""
        if not isinstance(bounds, Mapping):
            raise _bad_bounds(f"expected bounds by name, got {bounds!r:.60}", "such as {'forearm.mass': (1.0, 3.0)}")
        out, at = np.array([[-np.inf], [np.inf]]).repeat(len(self.names), axis=1), 0
        values = dict(zip(self.names, self.values(np.zeros(len(self.names))).tolist(), strict=True))
        for name in bounds:
            require_known(name, self.names, QueryError, "nothing that is looked for is called {!r}", argument="bounds")
        for group in self._groups:
            for place, name in enumerate(group.names):
                pair = bounds.get(name, (-np.inf, np.inf))
                if np.shape(pair) != (2,):
                    raise _bad_bounds(f"expected the least and the largest {name}, got {pair!r:.60}",
                                      "such as (1.0, 3.0)")  # fmt: skip
                low, high = pair
                if group.inverse is None and name in bounds:
                    raise _bad_bounds(f"{name} has no bounds where all ten parameters of a body are looked for",
                                      "leave it out: only bodies that can exist are tried")  # fmt: skip
                low = max(float(low), group.lowest)
                if not low <= values[name] <= float(high):
                    raise _bad_bounds(f"{name} starts at {values[name]:g}, not from {low:g} to {high:g}",
                                      "give wider bounds, or a guess within them")  # fmt: skip
                if group.inverse is not None:
                    out[:, at] = [x if np.isinf(x) else group.inverse(place, float(x)) for x in (low, high)]
                at += 1
        return out[0], out[1]

    def lacking(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues (m,) near 0 of bodies of which a part is looked for, and their derivatives (m, k).

        A body can exist where no eigenvalue of its pseudo-inertia is negative (Wensing, Kim and Slotine 2018); those
        that are here are nearer to 0 than a small margin, which is taken off.
        """
        values, rows, first = [np.empty(0)], [np.empty((0, len(z)))], 0
        for group, part in self._parts(z):
            own = slice(first, first := first + len(part))
            if group.to_body is None:
                continue
            with np.errstate(over="ignore", invalid="ignore"):
                matrices = [pseudo_inertia(group.to_body(part + 1j * _STEP * e)) for e in np.eye(len(part))]
            if not np.isfinite(matrices).all():  # a step too far: there is no such motion either
                continue
            found, vectors = np.linalg.eigh(matrices[0].real)
            least = np.linalg.eigvalsh(pseudo_inertia(group.to_body(np.zeros(len(part)))))[0]
            margin = min(_MARGIN * found[-1], 0.5 * least)
            late = found < 0.5 * margin
            if least <= 0.0 or not late.any():  # the scene's own cannot exist
                continue
            values.append(found[late] - margin)
            rows.append(np.zeros((int(late.sum()), len(z))))
            rows[-1][:, own] = np.einsum("ai,jab,bi->ij", vectors, np.imag(matrices) / _STEP, vectors)[late]
        return np.concatenate(values), np.concatenate(rows)

    def scene_at(self, z: np.ndarray) -> Scene:
        """The scene with the values of z. Raises SceneError where there is no such scene."""
        robot, constants = self.scene.robot, dict[str, float]()
        change = {"q": np.zeros(robot.nv), "v": np.zeros(robot.nv)}
        dofs = {joint.name: joint.v for joint in robot.joints}
        for group, part in self._parts(z):
            values = group.chart(part)[1]
            if group.of_state:
                letter, _, joint = group.constants[0].partition(".")
                change[letter][dofs[joint]] = values
            else:
                constants.update(zip(group.constants, values.tolist(), strict=True))
        own = scene_with(self.scene, constants) if constants else self.scene
        self._require_bodies(own)
        q, v = robot.integrate(own.q, change["q"]), own.v + change["v"]
        return own.with_start(q, v)

    def _require_bodies(self, scene: Scene) -> None:
        """Refuse a body that cannot exist where the scene's own can. Raises SceneError."""
        for before, after in zip(self.scene.robot.model.inertias, scene.robot.model.inertias, strict=True):
            if _can_exist(before) and not _can_exist(after):
                raise SceneError(f"no body has {after.mass:g} kg and the inertia {after.inertia.tolist()}",
                                 where="parameters", remedy="look for all ten parameters of the body",
                                 code="impossible-inertia")  # fmt: skip

    def _parts(self, z: np.ndarray) -> list[tuple[_NameGroup, np.ndarray]]:
        ends = np.cumsum([len(group.names) for group in self._groups])
        return list(zip(self._groups, np.split(z, ends[:-1]), strict=True))


def _bad_bounds(what: str, remedy: str) -> QueryError:
    return QueryError(what, argument="bounds", remedy=remedy, code="bounds")


def unknowns_of(scene: Scene, parameters: Sequence[str]) -> Unknowns:
    """The unknowns that names and patterns ask for.

    Raises
    ------
    SceneError
        A name is unknown (code "unknown-parameter") or cannot be looked for (code "sensitivity-undefined").
    QueryError
        Code "mixed-parameters".
    """
    require_list(parameters, "q.elbow")
    constants = [i for i, effect in enumerate(scene.effects) if isinstance(effect, Constants)]
    every = parameters_of(scene)
    lowest = {name: parameter.lowest for name, parameter in every.items()}
    numbers = {name: parameter.nominal for name, parameter in every.items()
               if np.isfinite(parameter.nominal) and parameter.kind in ("constant", "effect")
               and not name.startswith(tuple(f"{PREFIX}{i}." for i in constants))}  # fmt: skip
    links = body_names(scene.robot.model)[1:]
    of_bodies = {f"{link}.{part}": link for link in links for part in (*BODY_PARAMETERS, *_CENTRAL)}
    of_state = [f"{letter}.{joint.name}" for letter in "qv" for joint in scene.robot.joints]
    known = dict.fromkeys([*of_bodies, *numbers, *of_state])
    patterned = [f"{link}.{part}" for link in links for part in BODY_PARAMETERS]
    patterned += [name for name in numbers if name.startswith(PREFIX)] + of_state
    found = dict.fromkeys(name for text in parameters for name in _named(scene, str(text), known, patterned))
    by_link: dict[str, list[str]] = {}
    groups = []
    for name in found:
        if name in of_bodies:
            by_link.setdefault(of_bodies[name], []).append(name.removeprefix(f"{of_bodies[name]}."))
        elif name in of_state:
            groups.append(_state(scene, name))
        else:
            groups.append(_number(name, numbers[name], lowest[name]))
    bodies = [_body(scene, link, links.index(link), parts) for link, parts in by_link.items()]
    return Unknowns(scene, [*bodies, *groups])


def _named(scene: Scene, text: str, known: Collection[str], patterned: Sequence[str]) -> list[str]:
    """The names that a text stands for: its own, the joints of "q" and "v", or those that fit a pattern."""
    if text in ("q", "v"):
        return [f"{text}.{joint.name}" for joint in scene.robot.joints]
    joint, _, kind = text.rpartition(".")
    if kind in ("damping", "friction") and not text.startswith(PREFIX) and joint in scene.robot.joint_names:
        raise SceneError(f"the scene has no effect whose number is {text!r}", argument="parameters",
                         remedy=_of_an_effect(scene, joint, kind), code="unknown-parameter")  # fmt: skip
    fitting = [text] if text in known else [name for name in patterned if fnmatchcase(name, text)]
    if not fitting:
        about = named_parameters(scene, [text], "parameters", known)[0].about
        raise SceneError(f"there are no derivatives by {text!r}: {about}", argument="parameters",
                         remedy="look for another number", code="sensitivity-undefined")  # fmt: skip
    return fitting


def _of_an_effect(scene: Scene, joint: str, kind: str) -> str:
    """The remedy by which the damping or friction of a joint is looked for."""
    if kind == "friction":
        return f"look for a number of a friction effect, such as effects.1.kinetic.{joint}"
    place = next((i for i, e in enumerate(scene.effects) if isinstance(e, JointDamping)), None)
    if place is not None:
        return f"look for effects.{place}.damping.{joint}"
    return f"add tl.effects.JointDamping({{{joint!r}: 0.1}}) and look for effects.{len(scene.effects)}.damping.{joint}"


def _number(name: str, value: float, lowest: float) -> _NameGroup:
    """A constant or a number of an effect: value + z times its size; not lower, as rounding may make it."""
    scale = abs(value) or 1.0

    def chart(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = value + scale * z
        moved = moved + np.maximum(lowest - moved.real, 0.0)
        return moved, moved

    return _NameGroup((name,), (name,), chart, inverse=lambda _, x: (x - value) / scale, lowest=lowest)


def _state(scene: Scene, name: str) -> _NameGroup:
    """The initial state of a joint, moved along its tangent directions; the value of one coordinate, else the move."""
    letter, _, joint_name = name.partition(".")
    joint = next(joint for joint in scene.robot.joints if joint.name == joint_name)
    size = joint.v.stop - joint.v.start
    start = np.zeros(size)
    if letter == "v":
        start = scene.v[joint.v].copy()
    elif size == 1:
        own = scene.q[joint.q]
        start = own.copy() if joint.kind == "vector" else np.array([np.arctan2(own[1], own[0])])
    names = (name,) if size == 1 else tuple(f"{name}.{k}" for k in range(size))
    return _NameGroup(names, (name,), lambda z: (start + z, z), of_state=True, inverse=lambda i, x: float(x - start[i]))


def _body(scene: Scene, link: str, index: int, parts: Sequence[str]) -> _NameGroup:
    """Some or all of a body's ten parameters, about the joint's frame, or about the centre of mass."""
    of_origin = any(part not in _CENTRAL for part in parts)
    kinds = BODY_PARAMETERS if of_origin else _CENTRAL
    odd = next((part for part in parts if part not in kinds), None)
    if odd is not None:
        raise QueryError(f"{link}.{odd} cannot be looked for beside {link}.{next(p for p in parts if p in kinds[1:])}",
                         argument="parameters", code="mixed-parameters",
                         remedy="use first_moment and origin_inertia, or com and inertia")  # fmt: skip
    body = np.asarray(scene.robot.model.inertias[index + 1].toDynamicParameters())
    places = [kinds.index(part) for part in parts]
    shown = (lambda pi: pi) if of_origin else central
    inverse = None
    if len(parts) == len(kinds):
        to_body = log_cholesky_chart(body, scene.robot.mass)
    else:
        to_body, inverse = _linear_chart(body, places, of_origin)
    used = _CENTRAL if of_origin else tuple(parts)
    wanted = [_CENTRAL.index(part) for part in used]

    def chart(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pi = to_body(z)
        return shown(pi)[places], central(pi)[wanted]

    return _NameGroup(tuple(f"{link}.{part}" for part in parts), tuple(f"{link}.{part}" for part in used), chart,
                      inverse=inverse, to_body=inverse and to_body)  # fmt: skip


def _linear_chart(body: np.ndarray, places: Sequence[int], of_origin: bool) -> tuple[ToBody, ToCoordinate]:
    """z -> the ten parameters with others at these places; a mass is m0 exp(z). And the z of a value at a place."""
    start = body if of_origin else central(body)
    length = size_of(body)
    scales = np.array([1.0, *[body[0] * length if of_origin else length] * 3, *[body[0] * length**2] * 6])

    def chart(z: np.ndarray) -> np.ndarray:
        values = start.astype(z.dtype)
        for place, x in zip(places, z, strict=True):
            values[place] = start[0] * np.exp(x) if place == 0 else start[place] + scales[place] * x
        return values if of_origin else from_central(values)

    def inverse(number: int, value: float) -> float:
        place = places[number]
        return float(np.log(max(value, 1e-300) / start[0]) if place == 0 else (value - start[place]) / scales[place])

    return chart, inverse


def _can_exist(body: pin.Inertia) -> bool:
    return not is_impossible(body.inertia, body.mass)


def _complex_step(chart: Chart, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of both values by z."""
    moved = [chart(z + 1j * _STEP * direction) for direction in np.eye(len(z))]
    first, second = (np.stack([np.imag(pair[i]) / _STEP for pair in moved], axis=1) for i in (0, 1))
    return first, second
