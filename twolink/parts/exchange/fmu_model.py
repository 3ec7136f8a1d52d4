"""A smooth scene as an FMU knows it: variables, and the functions that its C code is written from.

    z = (t, pieces of tables, inputs, parameters, changes of both along a direction, x, its change)

x = (q, v, states of effects). Every function takes z alone, which an instance of the FMU holds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.algorithms.dual_numbers import Dual, DualNamespace
from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.spatial import plus
from twolink.algorithms.tape import Tape
from twolink.effects.inputs import Sampled, curve_end
from twolink.effects.switching import SwitchingEffect
from twolink.errors import CertificationError, SceneError, nearest
from twolink.integrate.derivatives.variational_steps import certify_variation, row_sizes, traced_variation
from twolink.integrate.motion.effect_numbers import nominal_vector, physical
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected, traced_rate
from twolink.integrate.motion.scene_equations import equations_of, structure_of, with_parameters
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.programs import AGREEMENT, STATES, certify_projection, certify_rate
from twolink.io.fingerprints import changed_joint
from twolink.parts.exchange.traced_functions import Traced
from twolink.robots.joint_layout import JointLayout, angular_dofs, joint_columns
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, named_parameters, parameters_of, with_effect_number


@dataclass(frozen=True)
class FmuVariable:
    """A variable of the FMU. of: what it is the rate of; depends: on what, by value reference; None: of no interest."""

    name: str
    about: str
    unit: str
    causality: str
    variability: str = "continuous"
    start: float | None = None
    of: int | None = None
    depends: tuple[int, ...] | None = None


@dataclass(frozen=True)
class FmuModel:
    """A scene as an FMU: its variables, which their places number, functions of z, and z at the start.

    counts: how many states, inputs, parameters and constants there are. tables: of samples. end: until when the scene
    says what acts, s.
    """

    equations: Equations
    variables: list[FmuVariable]
    functions: list[Traced]
    start: Array
    counts: tuple[int, int, int, int]
    tables: tuple[Sampled, ...]
    end: float


def fmu_model(scene: Scene, parameters: Sequence[str] | None) -> FmuModel:
    """A scene as an FMU, certified against Pinocchio. parameters: numbers to keep; None: as many as there are."""
    equations, inputs = _equations(scene, parameters)
    sizes = row_sizes(equations, 1, inputs)
    functions = _functions(equations, sizes, inputs)
    _certify(equations, inputs, functions)
    values = nominal_vector(equations)
    start = np.zeros(sum(sizes))
    start[1 + sizes[1] :][: len(values)] = values
    start[sum(sizes[:5]) :][: equations.moving] = equations.start[: equations.moving]
    variables, constants = _variables(scene, equations, sizes, inputs, (functions["rate"], functions["energy"]))
    tables = tuple(table for table in equations.layout.tables if isinstance(table, Sampled))
    ends = [table.times[-1] for table in tables if table.beyond == "error"]
    end = min([*ends, *map(curve_end, equations.effects)], default=np.inf)
    return FmuModel(equations, variables, list(functions.values()), start,
                    (equations.moving, inputs, len(values), constants), tables, end)  # fmt: skip


def _equations(scene: Scene, parameters: Sequence[str] | None) -> tuple[Equations, int]:
    """The equations under torques that are inputs, with parameters, and how many inputs there are."""
    for i, effect in enumerate(scene.effects):
        if effect.sampled is not None:
            raise _refused("it is called at ticks", scene, i)
        if effect.breaks(scene.duration):
            raise _refused("it is not smooth at all times", scene, i)
        if isinstance(effect, SwitchingEffect):
            raise _refused("it makes events", scene, i)
    if scene.robot.nv == 0:
        raise SceneError("no joint moves", where=f"robot {scene.robot.name!r}", code="nothing-moves",
                         remedy='free its base: load_robot(..., root="free")')  # fmt: skip
    driven, names = scene.with_held_torques()
    equations = equations_of(driven)
    if equations.effort_limits:
        place, name = equations.effort_limits[0]
        raise _refused(f"its limit makes events ({name})", scene, place)
    equations.require(0.0, 0.0)
    usual = tuple(name for name in structure_of(equations)[0].parameters if not _changes_robot(scene, name))
    if parameters is None:
        return with_parameters(equations, usual), len(names)
    named_parameters(scene, parameters, "parameters")
    known = {*usual, *_numbers(scene)}
    for name in parameters:
        if _changes_robot(scene, name):
            raise SceneError(f"{name!r} changes the robot when the FMU is written", argument="parameters",
                             code="no-fmu", remedy="take the armature of its joint, as in JOINT.armature")  # fmt: skip
        if name not in known:
            raise SceneError(f"{name!r} is no number of the equations", argument="parameters", code="no-fmu",
                             remedy=nearest(name, sorted(known)))  # fmt: skip
    return with_parameters(equations, tuple(dict.fromkeys(parameters))), len(names)


def _refused(why: str, scene: Scene, place: int) -> SceneError:
    what = f"{type(scene.effects[place]).__name__} cannot be in an FMU: {why}"
    return SceneError(what, where=f"effects[{place}]", code="no-fmu",
                      remedy=f"scene.without({place}): torques in its place are inputs of the FMU")  # fmt: skip


def _changes_robot(scene: Scene, name: str) -> bool:
    """True of numbers of an effect that acts beside changing the robot's constants: a ratio of a gear with a rotor."""
    if not name.startswith(PREFIX):
        return False
    place = int(name.split(".")[1])
    both = scene.effects[place], with_effect_number(scene.effects, name, 0.0)[place]
    return both[0].changes and bool(changed_joint(*(scene.base.changed(one.change).model for one in both)))


def _numbers(scene: Scene) -> list[str]:
    """The numbers of the equations by name. A joint's damping in the URDF is none: a JointDamping acts."""
    return [name for name, one in parameters_of(scene).items() if one.acts and not name.endswith(".damping")]


def _functions(equations: Equations, sizes: Sequence[int], inputs: int) -> dict[str, Traced]:
    """The functions of z by name."""
    names = equations.parameters

    def traced(name: str, about: str, formula: Callable[[Array, Tape], Sequence[Any]]) -> Traced:
        tape = Tape()
        z = np.array([tape.variable() for _ in range(sum(sizes))], dtype=object)
        return Traced(name, f"{name}: {about}", (("z", list(z)),), list(formula(z, tape)), tape)

    def split(z: Array) -> tuple[Any, Array, dict[str, Any], Array, list[Any], dict[str, Any]]:
        (t,), u, p, _, direction, x, dx = np.split(z, np.cumsum(sizes)[:-1])
        duals = [Dual(a, [d]) for a, d in zip(x, dx, strict=True)]
        changed = {n: Dual(a, [d]) for n, a, d in zip(names, p, direction[inputs:], strict=True)}
        return t, np.concatenate([x, u]), dict(zip(names, p, strict=True)), x, duals, changed

    def rate(z: Array, xp: Tape) -> Sequence[Any]:
        t, state, values, x, _, _ = split(z)
        return list(traced_rate(equations, t, state, xp, values)[: len(x)])

    def on_manifold(z: Array, xp: Tape) -> Sequence[Any]:
        _, state, values, x, _, _ = split(z)
        return list(projected(equations, state, xp, values)[: len(x)])

    def energy_change(z: Array, xp: Tape) -> Sequence[Any]:
        *_, duals, changed = split(z)
        found = _energy(equations, np.array(duals, dtype=object), changed, DualNamespace(xp))
        return [found.value, found.tangents[0]]

    made = [
        traced("rate", "x'.", rate),
        traced("variation", "x', and its change along the direction.",
               lambda z, xp: traced_variation(equations, 1, inputs, z, xp)),
        traced("projected", "x with unit quaternions and closed loops.", on_manifold),
        traced("energy", "kinetic energy, and potential energy of gravity, J.",
               lambda z, xp: [_energy(equations, split(z)[3], split(z)[2], xp)]),
        traced("energy_variation", "the energy, and its change along the direction.", energy_change),
    ]  # fmt: skip
    return {one.name: one for one in made}


def _energy(equations: Equations, x: Array, values: dict[str, Any], xp: Any) -> Any:
    """The energy [J] of x (moving,)."""
    space, of = equations.space, function(equations.robot.model, "energy")
    unit = space.normalized(x, xp)
    arguments = {"q": list(unit[: space.nq]), "v": list(unit[space.v_rows])}
    return plus(*of.variants[0](mechanism(equations.robot.model, physical(values)), arguments, xp))


def _certify(equations: Equations, inputs: int, functions: dict[str, Traced]) -> None:
    """Compare the functions with Pinocchio, and their derivatives with differences. Raises CertificationError."""
    size, moving, space = equations.space.size, equations.moving, equations.space
    directions = inputs + len(equations.parameters)

    def called(name: str, t: Array, x: Array, values: Array) -> Array:
        still = np.zeros((directions, x.shape[1]))
        z = np.concatenate([t, x[moving:], values, still, x[:moving], np.zeros((moving, x.shape[1]))])
        return functions[name]([z.T]).T

    with np.errstate(all="ignore"):
        certify_rate(equations, lambda rows: called("rate", rows[:1], rows[1 : 1 + size], rows[1 + size :]))
        certify_variation(equations, lambda rows: functions["variation"]([rows.T]).T, 1, inputs)
        if space.curved or equations.constraints is not None:
            at_start = np.zeros((1, STATES))
            certify_projection(equations, lambda rows: called("projected", at_start, rows[:size], rows[size:]))
    q, v = equations.robot.random_state(STATES, seed=1)
    x = np.concatenate([q.T, v.T, np.zeros((size - space.v_rows.stop, STATES))])
    values = np.repeat(nominal_vector(equations)[:, None], STATES, axis=1)
    parts = np.array(equations.robot.energy(q, v, engine="pinocchio"))
    found = called("energy", np.zeros((1, STATES)), x, values)[0]
    error = float((np.abs(found - parts.sum(axis=0)) / (1.0 + np.abs(parts).max(axis=0))).max())
    if not error <= AGREEMENT:
        raise CertificationError(f"the energy differs from Pinocchio's by {error:.1e}", where="energy",
                                 remedy="report it, with the robot")  # fmt: skip


def _variables(
    scene: Scene, equations: Equations, sizes: Sequence[int], inputs: int, traced: tuple[Traced, Traced]
) -> tuple[list[FmuVariable], int]:
    """The variables in the order of their value references, and how many constants there are."""
    space, joints, known = equations.space, scene.robot.joints, parameters_of(scene)
    units = {letter: [unit for joint in joints for unit in _units(joint, letter)] for letter in ("q", "v")}
    names = {letter: [name for name, _ in joint_columns(joints, letter)] for letter in ("q", "v", "a", "tau")}
    states = [
        *((name, f"configuration of {name[2:]}", unit) for name, unit in zip(names["q"], units["q"], strict=True)),
        *((name, f"velocity of {name[2:]}", f"{unit}/s") for name, unit in zip(names["v"], units["v"], strict=True)),
        *(
            (f"z.{name}", f"state of an effect: {name}; its start is that of the scene's own q and v", "")
            for name in space.states
        ),
    ]
    count = len(states)
    rows = {0: 0} | {1 + sizes[1] - inputs + i: 1 + 2 * count + i for i in range(inputs)}
    rows |= {sum(sizes[:5]) + i: 1 + i for i in range(count)}

    def depends(one: Traced, i: int) -> tuple[int, ...]:
        return tuple(sorted(rows[k] for k in one.tape.inputs(one.outputs[i]) if k in rows))

    found = [FmuVariable("time", "time", "s", "independent")]
    found += [FmuVariable(*state, "output", start=float(x), depends=(1 + i,))
              for i, (state, x) in enumerate(zip(states, equations.start[:count], strict=True))]  # fmt: skip
    for i, (name, _, unit) in enumerate(states):
        accelerates = space.nq <= i < space.v_rows.stop
        own = names["a"][i - space.nq] if accelerates else f"der({name})"
        of = f"acceleration of {name[2:]}" if accelerates else f"rate of {name}"
        per_second, kind = f"{unit}/s".replace("/s/s", "/s^2") if unit else "", "output" if accelerates else "local"
        found.append(FmuVariable(own, of, per_second, kind, of=1 + i, depends=depends(traced[0], i)))
    found += [FmuVariable(name, f"torque or force on {name[4:]}", "N m" if unit == "rad" else "N", "input", start=0.0)
              for name, unit in zip(names["tau"], units["v"], strict=True)]  # fmt: skip
    found.append(FmuVariable("energy", "kinetic energy, and potential energy of gravity", "J", "output",
                             depends=depends(traced[1], 0)))  # fmt: skip
    fixed = [name for name in _numbers(scene) if name not in equations.parameters]
    nominal = dict(zip(equations.parameters, nominal_vector(equations).tolist(), strict=True))
    for name in (*equations.parameters, *fixed):
        one, kept = known[name], name in nominal
        unit = "" if one.unit == "SI units" else one.unit
        found.append(FmuVariable(name, one.about, unit, "parameter" if kept else "local",
                                 "tunable" if kept else "constant", nominal.get(name, one.nominal)))  # fmt: skip
    twice = next((v.name for i, v in enumerate(found) if any(v.name == w.name for w in found[:i])), None)
    if twice is not None:
        raise SceneError(f"two variables would be called {twice!r}", where="robot", code="no-fmu",
                         remedy="give the link or the joint another name")  # fmt: skip
    return found, len(fixed)


def _units(joint: JointLayout, letter: str) -> list[str]:
    """The unit of each entry of q of a joint; of v, that which passes in a second."""
    part = joint.v if letter == "v" else joint.q
    lengths = joint.v.stop - joint.v.start - len(angular_dofs(joint))
    turning = "1" if letter == "q" and joint.normalized is not None else "rad"
    return ["m"] * lengths + [turning] * (part.stop - part.start - lengths)
