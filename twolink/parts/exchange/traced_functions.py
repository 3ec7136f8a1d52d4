"""Functions of a robot as lists of operations, which code can be written from: traced, and held against Pinocchio."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.references import ModelState
from twolink.algorithms.tape import Symbol, Tape
from twolink.dynamics import Robot
from twolink.dynamics.certificates import BOUND, certify
from twolink.errors import CertificationError, QueryError, nearest, shown
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import ELSEWHERE, METHODS, Tableau
from twolink.integrate.steps.step_formulas import explicit_step
from twolink.native.machine import Program, assembled

VECTORS = 4  # states of a test
Vectors = tuple[list[np.ndarray], np.ndarray, np.ndarray]  # arguments, results and their scale, (VECTORS, ...)


@dataclass(frozen=True, eq=False)
class Traced:
    """A function as operations on symbols. arguments: names, sizes and symbols; outputs: symbols and constants.

    about: one line for people. shape: of the results, a vector by default. operations counts them by kind.
    """

    name: str
    about: str
    arguments: tuple[tuple[str, list[Symbol]], ...]
    outputs: list[Any]
    tape: Tape
    shape: tuple[int, ...] = (-1,)

    @property
    def operations(self) -> dict[str, int]:
        """Counts of the operations by their kind."""
        return self.tape.count(self.outputs)

    def needed(self) -> list[tuple[int, tuple[Any, ...]]]:
        """The operations behind the outputs, in an order that they can be computed in: (number, (kind, operands))."""
        return [(key, self.tape.operations[key]) for key in self.tape.needed(self.outputs)]

    def __call__(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """The results (n, *shape) for arguments (n, size)."""
        inputs = [symbol for _, symbols in self.arguments for symbol in symbols]
        program = Program(assembled(self.tape, inputs, self.outputs))
        return program(np.concatenate(columns, axis=1).T).T.reshape(len(columns[0]), *self.shape)


def function_of(robot: Robot, name: str) -> tuple[Traced, str, Vectors]:
    """A compiled query: its cheapest formula, certified against Pinocchio; its certificate; test vectors."""
    try:
        of = function(robot.model, name)
    except QueryError as error:
        raise error.at("functions", argument="functions") from None
    found = []
    for formula in of.variants:
        tape = Tape()
        symbols = {argument: [tape.variable() for _ in range(size)] for argument, size in of.arguments}
        outputs = formula(mechanism(robot.model), dict(symbols), tape)
        shape = " x ".join(map(str, of.shape)) or "1"
        found.append(Traced(name, f"{name}: out has {shape} numbers.", tuple(symbols.items()), outputs, tape, of.shape))
    traced = min(found, key=lambda one: sum(one.operations.values()))
    certificate = certify(robot, of, traced)  # type: ignore[arg-type]
    told = f"{name}: {certificate.states} states against the reference, "
    told += f"worst error {certificate.worst:.1e} of its scale"
    arguments = _states(robot, [argument for argument, _ in of.arguments])
    answers = [of.reference(ModelState(robot.model, {k: x[i] for k, x in arguments.items()})) for i in range(VECTORS)]
    expected = np.array([np.ravel(value) for value, _ in answers])
    return traced, told, (list(arguments.values()), expected, np.array([np.max(s) for _, s in answers]))


def step_of(robot: Robot, name: str) -> tuple[Traced, str, Vectors]:
    """One step of an explicit method under torques that stay, certified against Pinocchio's accelerations."""
    wanted = name.partition(":")[2] or "rk4"
    tableaux = {key: method.tableau for key, method in METHODS.items()}
    explicit = {key: one for key, one in tableaux.items() if isinstance(one, Tableau) and not any(one.diagonal)}
    if (ours := ELSEWHERE.get(wanted, wanted)) not in explicit:
        raise QueryError(f"{shown(wanted)} has no explicit steps", argument="functions", remedy=nearest(ours, explicit))
    tableau = explicit[ours]
    space, tape = StateSpace(robot), Tape()
    forward = function(robot.model, "forward_dynamics")
    mech, nq = mechanism(robot.model), robot.nq
    sizes = {"q": nq, "v": robot.nv, "tau": robot.nv, "h": 1}
    symbols = {argument: [tape.variable() for _ in range(size)] for argument, size in sizes.items()}

    def traced_rate(_: Any, x: Array) -> Array:
        unit = space.normalized(x, tape)
        arguments = {"q": list(unit[:nq]), "v": list(x[nq:]), "tau": symbols["tau"]}
        a = forward.variants[-1](mech, arguments, tape)
        return np.concatenate([space.rate(x[:nq], x[nq:]), np.array(a, dtype=object)])

    x = np.array([*symbols["q"], *symbols["v"]], dtype=object)
    after = space.normalized(explicit_step(tableau, traced_rate, 0.0, x, symbols["h"][0])[0], tape)
    about = f"{name}: q and v, one step of {ours} of h seconds later; tau stays."
    traced = Traced(name, about, tuple(symbols.items()), list(after), tape)
    arguments = _states(robot, ["q", "v", "tau"])
    columns = [*arguments.values(), np.full((VECTORS, 1), 1e-3)]
    expected = np.stack([_pinocchio_step(robot, space, tableau, *(c[i] for c in columns))
                         for i in range(VECTORS)])  # fmt: skip
    scale = np.maximum(1.0, np.abs(expected).max(axis=1))
    worst = float((np.abs(traced(columns) - expected).max(axis=1) / scale).max())
    if not worst <= BOUND:
        raise CertificationError(f"the step differs from Pinocchio's by {worst:.1e} of its scale", where=name,
                                 remedy="report it, with the robot")  # fmt: skip
    told = f"{name}: {VECTORS} steps against Pinocchio's accelerations, worst error {worst:.1e} of the scale"
    return traced, told, (columns, expected, scale)


def _pinocchio_step(
    robot: Robot, space: StateSpace, tableau: Tableau, q: Array, v: Array, tau: Array, h: Array
) -> np.ndarray:
    """One explicit step of (q, v) by Pinocchio's accelerations, for a comparison."""

    def rate(_: Any, x: Array) -> Array:
        unit = robot.normalize(x[: robot.nq])
        a = robot.forward_dynamics(unit, x[robot.nq :], tau, engine="pinocchio")
        return np.concatenate([space.rate(x[: robot.nq], x[robot.nq :]), a])

    after = explicit_step(tableau, rate, 0.0, np.concatenate([q, v]), h[0])[0]
    return np.concatenate([robot.normalize(after[: robot.nq]), after[robot.nq :]])


def _states(robot: Robot, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Arguments of the self test."""
    q, v = robot.random_state(VECTORS, seed=99)
    other = np.asarray(np.random.default_rng(99).uniform(-5, 5, v.shape))
    return {name: {"q": q, "v": v}.get(name, other) for name in names}
