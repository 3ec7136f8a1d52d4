"""Joint models: the torques of drives, linear in their coefficients, and which of them the data ask for.

    viscous     JOINT.damping v                     offset      JOINT.offset
    coulomb     JOINT.friction sign(v)              asymmetric  JOINT.asymmetry |sign(v)|
    rotor       JOINT.armature a                    stribeck    JOINT.stribeck sign(v) exp(-(v / v_s)^2)

Where motors act on several joints, v_joint = C v_motor, each law holds at a motor, and the joints feel C^-T times it.

Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, "Friction models and friction compensation",
European Journal of Control 4.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array
from twolink.dynamics.regressors import JOINT_PARAMETERS
from twolink.errors import QueryError, require_known
from twolink.io.text import Table
from twolink.parts.identification.base_parameters import (
    Selection,
    Term,
    base_parameters,
    direction,
    select,
    single_joints,
)
from twolink.parts.identification.filtering import ALIKE, Folds, Recording, States, System
from twolink.parts.identification.measurements import Measurements, linear_system

WORDS = {"viscous": "damping", "coulomb": "friction", "rotor": "armature", "offset": "offset",
         "asymmetric": "asymmetry", "stribeck": "stribeck"}  # fmt: skip
STRIBECK = 0.1  # rad/s or m/s, of Stribeck's friction where none is stated
_WIDER = (1.0, 3.0, 10.0, 30.0, 100.0)  # times the speeds that cannot be told from rest
_SLOW = 0.02  # of a joint's usual speed: without a filter no sign of less is known
_TURNS = 0.05  # of a joint's usual speed: friction that turns over more is viscous
_PAYS = 0.01  # of the mean square: a joint model that leaves that much less is worth its coefficients
_FRICTION = ("", "viscous", "coulomb", "viscous+coulomb", "viscous+coulomb+offset", "viscous+coulomb+stribeck",
             "viscous+coulomb+offset+stribeck")  # fmt: skip
CANDIDATES = tuple("+".join(filter(None, (words, rotor))) for rotor in ("", "rotor") for words in _FRICTION)


def joint_terms(robot: Robot, model: Any, coupling: ArrayLike | None = None) -> tuple[list[str], tuple[Term, ...]]:
    """The parameters of the robot, and the terms beside them, that a joint model stands for.

    model: words with + between them, a function (q, v, a) -> torques, a list of both, or these by joint; "auto": all
    that it chooses among. coupling: C (nv, nv).

    Raises
    ------
    QueryError
        A word or joint is unknown, a number or shape is wrong.
    """
    inverse = _inverse(robot, coupling)
    joints = single_joints(robot)
    parameters, terms = dict[str, None](), dict[str, Term]()
    for pattern, given in (model if isinstance(model, Mapping) else {"*": model}).items():
        fitting = [name for name in joints if fnmatchcase(name, pattern)]
        if not fitting:
            require_known(pattern, joints, QueryError, "there is no joint {!r} of one degree of freedom",
                          argument="joint_model")  # fmt: skip
        for word in _words(given):
            if callable(word):
                terms[word.__name__] = Term(word.__name__, _checked(robot, word))
                continue
            kind, speed = _kind_of(word)
            for name in fitting:
                if coupling is None and kind in JOINT_PARAMETERS:
                    parameters[f"{name}.{kind}"] = None
                else:
                    own = f"{name}.{kind}" if coupling is None else f"{name}.motor_{kind}"
                    terms[own] = Term(own, _law(kind, speed, inverse, joints[name]))
    return list(parameters), tuple(terms.values())


def _words(given: Any) -> list[Any]:
    """The words and functions of a joint model."""
    if isinstance(given, str):
        given = {"auto": CANDIDATES[-1], "none": ""}.get(given, given)
        return [word.strip() for word in given.split("+") if word.strip()]
    if callable(given):
        return [given]
    if isinstance(given, list | tuple):
        return [word for one in given for word in _words(one)]
    raise QueryError(f"expected words, functions or a mapping of joints to them, got {given!r:.60}",
                     argument="joint_model", remedy='such as "viscous+coulomb+offset"')  # fmt: skip


def _kind_of(word: str) -> tuple[str, float]:
    """The law and Stribeck's velocity of "viscous" or "stribeck:0.05"."""
    name, _, speed = word.partition(":")
    require_known(name, WORDS, QueryError, "there is no joint model {!r}", argument="joint_model")
    try:
        value = float(speed or STRIBECK)
    except ValueError:
        value = 0.0
    if not 0 < value < np.inf or (speed and name != "stribeck"):
        raise QueryError(f"expected a velocity behind stribeck: only, got {word!r:.60}", argument="joint_model",
                         remedy='such as "viscous+stribeck:0.1"')  # fmt: skip
    return WORDS[name], value


def _law(kind: str, speed: float, inverse: np.ndarray, dof: int) -> Callable[..., np.ndarray]:
    def torque(_q: np.ndarray, v: np.ndarray, a: np.ndarray, width: np.ndarray) -> np.ndarray:
        v, a, noise = v @ inverse[dof], a @ inverse[dof], np.asarray(np.linalg.norm(width * inverse[dof]))
        sign = direction(v, noise)
        laws = {"damping": v, "friction": sign, "armature": a, "offset": np.ones_like(v), "asymmetry": np.abs(sign),
                "stribeck": sign * np.exp(-((v / speed) ** 2))}  # fmt: skip
        return np.asarray(laws[kind][..., None] * inverse[dof])

    return torque


def _inverse(robot: Robot, coupling: ArrayLike | None) -> np.ndarray:
    """C^-1. Raises QueryError where there is none."""
    if coupling is None:
        return np.eye(robot.nv)
    matrix = array("coupling", coupling, robot.nv)
    if matrix.shape != (robot.nv, robot.nv) or np.linalg.cond(matrix) > 1e8:
        raise QueryError(f"expected a matrix ({robot.nv}, {robot.nv}) that has an inverse, got shape {matrix.shape}",
                         argument="coupling", remedy="give C of v_joint = C v_motor")  # fmt: skip
    return np.linalg.inv(matrix)


def _checked(robot: Robot, column: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """The function, whose torques have the right shape and are finite. Raises QueryError."""

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray, _width: np.ndarray) -> np.ndarray:
        values = np.asarray(column(q, v, a), dtype=float)
        if values.shape != v.shape or not np.all(np.isfinite(values)):
            what = f"{column.__name__} gave torques of shape {values.shape}, expected finite ones of shape {v.shape}"
            raise QueryError(what, argument="joint_model", remedy="give a function of arrays (n, nq), (n, nv), (n, nv)")
        return values

    torque(*robot.random_state(3), np.zeros((3, robot.nv)), np.zeros(1))
    return torque


def explaining(robot: Robot, runs: Sequence[Recording], chosen: Selection | None = None) -> System:
    """The equations y = G theta of all bodies and drives, and of what is looked for, from states and torques.

    What is not looked for may be in the torques too: a filter by these alone would follow it.
    """
    drives = joint_terms(robot, "auto")
    terms = {term.name: term for term in (*drives[1], *(chosen.terms if chosen else ()))}
    rates = [robot.difference(run.q[:-1], run.q[1:]) / np.diff(run.t)[:, None] for run in runs]
    width = _SLOW * np.sqrt(np.mean(np.concatenate(rates) ** 2, axis=0))
    every = replace(select(robot, ["*"], drives[0], tuple(terms.values())), width=width)
    members = list(base_parameters(robot, every).members)

    def system(now: States, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns, known = every.system(robot, *now)
        return columns[..., members], tau - known

    return system


def with_width(robot: Robot, chosen: Selection, data: Measurements) -> Selection:
    """The selection whose friction turns over the width by which each joint's torques are predicted best.

    That is what cannot be told from rest, or more: elastic teeth and grease creep before they slide.
    """
    tried = []
    for factor in _WIDER if data.width.any() and chosen.rubbing else (1.0,):
        widest = np.maximum(_TURNS * np.sqrt(np.mean(data.v**2, axis=0)), data.width)
        now = replace(chosen, width=np.minimum(factor * data.width, widest))
        tried.append((folds_of(data, *linear_system(robot, now, data)).left_out(), now.width))
    scores, widths = (np.stack(x) for x in zip(*tried, strict=True))
    first = np.argmax(np.log(scores) <= np.log(scores).min(axis=0) + ALIKE, axis=0)
    return replace(chosen, width=np.take_along_axis(widths, first[None], axis=0)[0])


def folds_of(data: Measurements, columns: np.ndarray, y: np.ndarray) -> Folds:
    """The parts of averaged data, in which only torques of joints that move count."""
    moving = data.averaged(np.where(data.v == 0.0, 1e-3, direction(data.v, data.width) ** 2))
    return Folds(columns, y, data.block_ends, moving)


def best_terms(robot: Robot, chosen: Selection, data: Measurements) -> tuple[Selection, Table]:
    """The joint models by cross-validation, and what each candidate leaves of the torques of left-out parts.

    chosen: a selection with all terms. Each joint takes the candidate with fewest coefficients among those that leave
    it as little as the best, where it moves.
    """
    joints = single_joints(robot)
    every = {WORDS[word] for word in CANDIDATES[-1].split("+")}
    folds = folds_of(data, *linear_system(robot, chosen, data))

    def unused(words: Mapping[str, str]) -> set[str]:
        split = [(name, *name.rpartition(".")[::2]) for name in chosen.names]
        of = {joint: {WORDS[word] for word in text.split("+") if word} for joint, text in words.items()}
        kinds = [(name, joint, kind.removeprefix("motor_")) for name, joint, kind in split if joint in of]
        return {name for name, joint, kind in kinds if kind in every - of[joint]}

    def score(words: Mapping[str, str]) -> np.ndarray:
        drop = unused(words)
        return folds.left_out([k for k, name in enumerate(chosen.names) if name not in drop])

    scores = {words: np.log(score(dict.fromkeys(joints, words))) for words in CANDIDATES}
    best: dict[str, str] = {}
    for number in range(2):  # all joints alike, then each beside the best of the others
        for name, dof in joints.items():
            here = {w: np.log(score({**best, name: w})) for w in CANDIDATES} if number else scores
            least = min(values[dof] for values in here.values())
            good = [words for words, values in here.items() if values[dof] <= least + _PAYS]
            best[name] = min(good, key=lambda words: (len(words.split("+")) if words else 0, here[words][dof]))
    geared = any("rotor" in words for words in best.values())
    for name in joints:  # drives are alike: an inertia that may as well be a rotor's is then no body's alone
        if geared and "rotor" not in best[name]:
            words = "+".join(filter(None, (best[name], "rotor")))
            ranks = [len(base_parameters(robot, chosen.without(unused(of))).members)
                     for of in (best, {**best, name: words})]  # fmt: skip
            best[name] = words if ranks[0] == ranks[1] else best[name]
    rows = [(words or "none", *np.exp(values / 2).tolist()) for words, values in scores.items()]
    said = ", ".join(f"{name}: {words or 'none'}" for name, words in best.items())
    rows.append((said, *np.sqrt(score(best)).tolist()))
    names = ("joint model", *(f"left of {name}" for name in joints))
    table = Table(names, tuple((row[0], *(row[1 + k] for k in joints.values())) for row in rows))
    return chosen.without(unused(best)), table
