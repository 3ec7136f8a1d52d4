"""Making the equations of motion of a scene, and keeping them as long as the scene."""

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import Mechanism, mechanism, nominal_values
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.tape import Tape, collection_paused
from twolink.dynamics import Robot
from twolink.dynamics.certificates import with_values
from twolink.effects import Effect
from twolink.effects.effect import plain
from twolink.effects.inputs import with_pieces
from twolink.effects.loops import Loop
from twolink.effects.own_effects import formula_fingerprint, has_own
from twolink.effects.switching import Switching, switching_of
from twolink.errors import SceneError
from twolink.integrate.motion.assembly import assembled, independent
from twolink.integrate.motion.constraints import Constraints, all_constraints
from twolink.integrate.motion.effect_numbers import physical, with_effect_numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import accelerations, effect_loads, motion_of
from twolink.integrate.motion.state import Array, StateSpace, layout_of
from twolink.io.fingerprints import kernel_key
from twolink.native.programs import keep, kept
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, numbers_of, with_effect_number

if TYPE_CHECKING:
    from twolink.loop.sampled_loop import Sampling

_kept: weakref.WeakKeyDictionary[Scene, dict[tuple[Any, ...], Equations]] = weakref.WeakKeyDictionary()


def equations_of(
    scene: Scene, parameters: Sequence[str] = (), *, ticks: bool = False, variant: int | None = None
) -> Equations:
    """The equations of a scene.

    parameters: physical constants kept as run-time inputs. ticks: whether the caller solves from tick to tick, as
    controllers call for. variant: of the formula; None: that of the fewest operations. Raises SceneError.
    """
    sampling, effects = sampled(scene)
    if sampling is not None and not ticks:
        raise SceneError("a sampled controller acts at ticks, which this does not follow",
                         where=f"effects[{min(sampling.controllers)}]", code="controller-not-followed",
                         remedy="tl.simulate, tl.simulate_many; or a continuous one, such as JointPD")  # fmt: skip
    known = _kept.setdefault(scene, {})
    name = (variant, *parameters)
    if name not in known:
        switching = switching_of(scene.base, scene.robot, effects)
        acting = tuple(enumerate(effects)) if switching is None else switching.acting()
        robot = scene.robot if switching is None else switching.robot_with([effect for _, effect in acting])
        lockable = () if switching is None else switching.lockable
        equations = make_equations(robot, scene.q, scene.v, acting, lockable, switching, tuple(parameters),
                                   variant=variant)  # fmt: skip
        known[name] = replace(equations, sampling=sampling)
    return known[name]


def sampled(scene: Scene) -> "tuple[Sampling | None, Sequence[Effect]]":
    """The controllers and sensors of a scene, None without controllers; and its effects, with what those hold."""
    for i, effect in enumerate(scene.effects):
        inner: Any = effect
        while (inner := getattr(inner, "of", None)) is not None:
            if getattr(inner, "is_sensor", False) or (effect.sampled is None and getattr(inner, "sampled", None)):
                raise SceneError("a controller or sensor inside another effect is not called", where=f"effects[{i}].of",
                                 remedy="make it an effect of the scene; its update may return 0 while it waits",
                                 code="controller-not-followed")  # fmt: skip
    controllers = {i: one.sampled.on(scene.robot) for i, one in enumerate(scene.effects) if one.sampled is not None}
    if not controllers:
        return None, scene.effects
    from twolink.loop.sampled_loop import Sampling  # which other scenes do not load

    sensors = {i: effect for i, effect in enumerate(scene.effects) if effect.is_sensor}
    sampling = Sampling(scene.robot, controllers, sensors)  # type: ignore[arg-type]
    return sampling, [effect.held(scene.robot, i) for i, effect in enumerate(scene.effects)]


def with_parameters(equations: Equations, parameters: Sequence[str]) -> Equations:
    """Copy the equations with physical constants as run-time inputs; code for them serves any values of those."""
    if tuple(parameters) == equations.parameters:
        return equations
    other, ones = replace(equations, parameters=tuple(parameters)), dict.fromkeys(parameters, 1.0)
    model = with_values(equations.robot.model, physical(ones))
    return replace(other, content=_content(with_effect_numbers(other, ones), model))


def structure_of(equations: Equations) -> tuple[Equations, Array]:
    """Equations with numbers as run-time parameters, so that code for them serves other numbers; and the values (p,).

    Masses, inertias, gravity and the numbers of our own effects. What is 0 stays so; so do lengths, for which motions
    would take many more operations, and limits of effort, which decide about events.
    """
    key = equations.key("structure")
    found: tuple[Equations, Array] | None = kept(key)
    if found is None:
        model, chosen = equations.robot.model, {}
        for name, value in nominal_values(model).items():
            if value != 0.0 and ".origin." not in name and not name.endswith(".damping"):
                chosen[name] = value
        for place, effect in zip(equations.places, equations.effects, strict=False):
            if not has_own(effect):
                chosen |= {PREFIX + ".".join((str(place), *path)): value for path, value in numbers_of(effect)
                           if value and "effort" not in path}  # fmt: skip
        base = with_parameters(equations, tuple(chosen))
        found = keep(key, (base, np.array(list(chosen.values()))))
    return found


def make_equations(
    robot: Robot,
    q: Array,
    v: Array,
    effects: Sequence[tuple[int, Effect]],
    lockable: tuple[int, ...] = (),
    switching: Switching | None = None,
    parameters: tuple[str, ...] = (),
    states: Mapping[str, float] | None = None,
    variant: int | None = None,
) -> Equations:
    """Equations of a robot under effects, each with its place in the scene, from a state (q, v).

    The robot has the constants that effects changed. lockable: degrees of freedom that may be held at rest. states:
    those of effects, which may act later; None: those that the effects begin with. variant: as `equations_of` has it.
    """
    if robot.has_mimic:
        raise SceneError("robots with mimic=True answer queries, and cannot be simulated", where="robot",
                         remedy="leave it out, and add fx.Coupling, or take tl.scene_of of the file, which does",
                         code="mimic-joints")  # fmt: skip
    mech = mechanism(robot.model)
    acting = [(place, e) for place, e in effects if type(e).act is not Effect.act]
    loops = [(place, e) for place, e in effects if isinstance(e, Loop)]
    start, moved, constraints = np.concatenate([q, v]), np.zeros(len(q) + len(v)), None
    if loops:
        rows = all_constraints(StateSpace(robot), [loop for _, loop in loops], mech)
        closed = assembled(rows, start)
        start, moved = closed, np.abs(closed - start)
        constraints = independent(rows, start[: robot.nq])
    if states is None:
        begun = [e for _, e in effects] if switching is None else switching.every
        states = starting_states(begun, robot, mech, start)
    layout = layout_of(robot, [e for _, e in (*acting, *loops)], lockable, tuple(states))
    equations = Equations(
        layout,
        np.concatenate([start, np.array(list(states.values()), dtype=float), layout.numbers_at(0.0)]),
        robot,
        mech,
        tuple(e for _, e in acting),
        constraints,
        parameters,
        switching,
        places=tuple(place for place, _ in (*acting, *loops)),
        assembled=(float(moved[: robot.nq].max(initial=0.0)), float(moved[robot.nq :].max(initial=0.0))),
    )
    content = _content(equations)
    fewest = f"{content}-operations-{variant}"
    variant, operations, steady = kept(fewest) or keep(fewest, _fewest_operations(equations, variant))
    return replace(equations, variant=variant, operations=operations, steady=steady, content=content,
                   effort_limits=_effort_limits(equations))  # fmt: skip


def starting_states(effects: Sequence[Effect], robot: Robot, mech: Mechanism, x: Array) -> dict[str, Any]:
    """The states of effects at a start x (nq + nv, ...), by name. Raises SceneError, code "state-twice"."""
    found, nq = dict[str, Any](), robot.nq
    motion = KinematicState(robot.model, mech, list(x[:nq]), list(x[nq:]), 0.0, Numbers)
    for effect in effects:
        for name, value in effect.states(motion).items():
            if name in found:
                raise SceneError(f"two effects have a state {name!r}", where="effects", code="state-twice",
                                 remedy="keep one of a kind on a joint, or give muscles other names")  # fmt: skip
            found[name] = value
    return found


def decides_states(scene: Scene, name: str) -> bool:
    """True if which states effects have depends on whether the number of this name is 0, as of the gains of a PID."""
    if not name.startswith(PREFIX):
        return False
    mech, start = mechanism(scene.robot.model), np.concatenate([scene.q, scene.v])
    none, some = (starting_states(with_effect_number(scene.effects, name, number), scene.robot, mech, start)
                  for number in (0.0, 1.0))  # fmt: skip
    return none.keys() != some.keys()


def require_no_states(equations: Equations, what: str) -> None:
    """Require that no effect has states of its own. Raises SceneError, code "states-of-effects"."""
    if equations.space.states:
        raise SceneError(f"{what} does not follow states of effects, such as {equations.space.states[0]!r}",
                         where="effects", remedy="leave these effects out, or simulate the scene",
                         code="states-of-effects")  # fmt: skip


def with_starting_states(equations: Equations, x: Array, values: Mapping[str, Array] | None = None) -> Array:
    """States (moving, n) with what effects begin with behind states (q, v) (nq + nv, n). values (n,): of parameters."""
    if not equations.space.states:
        return x
    acting, switching = with_effect_numbers(equations, values or {}).effects, equations.switching
    effects = acting if switching is None else switching.every
    states = starting_states(effects, equations.robot, equations.mechanism, x).values()
    return np.concatenate([x, *(np.broadcast_to(z, x.shape[1:])[None] for z in states)])


def with_rows(equations: Equations, constraints: Constraints, kept: Sequence[int]) -> Equations:
    """The equations with fewer of their kept constraint rows."""
    scales = tuple(constraints.scales[constraints.kept.index(i)] for i in kept)
    changed = replace(equations, constraints=replace(constraints, kept=tuple(kept), scales=scales, shares=None))
    return replace(changed, content=_content(changed))


def _effort_limits(equations: Equations) -> tuple[tuple[int, str], ...]:
    """The places of the effects that have limits of effort, and their names."""
    motion = motion_of(equations, equations.mechanism, 0.0, equations.start, Numbers)
    numbers = list(equations.start[equations.moving :])
    placed = zip(equations.places, equations.effects, strict=False)
    with np.errstate(all="ignore"):  # of a singular start only the names are asked for
        return tuple((place, name) for place, effect in placed
                     for name, _ in effect_loads(equations, motion, numbers, [effect]).limits)  # fmt: skip


def _fewest_operations(equations: Equations, variant: int | None = None) -> tuple[int, int, tuple[int, ...]]:
    """The formula of the accelerations with the fewest operations, their number, and the rows whose rate is 0 by it.

    variant: the only one to look at.
    """
    looked_at: Sequence[int] = (variant,) if variant is not None else (0,)
    if variant is None and equations.constraints is None and not equations.layout.lockable:
        looked_at = function(equations.robot.model, "forward_dynamics").candidates(equations.mechanism)
    with collection_paused():
        found = [(i, *_operations(replace(equations, variant=i))) for i in looked_at]
    return min(found, key=lambda one: one[1])


def _operations(equations: Equations) -> tuple[int, tuple[int, ...]]:
    """The operations of one evaluation of the accelerations, and the rows of a state whose rate is 0 by it."""
    tape = Tape()
    x = [tape.variable() for _ in range(equations.space.size)]
    values = {name: tape.variable() for name in equations.parameters}
    mech = mechanism(equations.robot.model, physical(values)) if values else equations.mechanism
    own = with_effect_numbers(equations, values)
    rates = accelerations(own, mech, tape.variable(), x, tape)
    steady = tuple(equations.space.v_rows.start + i for i, rate in enumerate(rates)
                   if not isinstance(rate, tape.symbol) and rate == 0.0)  # fmt: skip
    return sum(tape.count(rates).values()), steady


def _content(equations: Equations, model: pin.Model | None = None) -> str:
    """A digest of the model, the robot's own or another, the effects, our code and versions.

    A table stands by its place and kind: its samples are rows of the state.
    """
    constraints = equations.constraints
    tables = {id(table): f"{i} {type(table).__name__} {table.rows}" for i, table in enumerate(equations.layout.tables)}
    effects = [
        f"{type(e).__module__}.{type(e).__qualname__} {_encoded(with_pieces(e, lambda table: tables[id(table)]))!r}"
        + formula_fingerprint(e, equations.robot.model)
        for e in (*equations.effects, *(constraints.loops if constraints else ()))
    ]
    rows = f"{constraints and (constraints.kept, constraints.scales, constraints.shares)} {equations.layout.lockable}"
    if equations.space.states:  # an effect that begins later has its states from the start
        rows += f" {equations.space.states}"
    return kernel_key(model or equations.robot.model, ("equations", *effects, rows, "|", *equations.parameters))


def _encoded(effect: Effect) -> bytes:
    return msgspec.json.encode(effect, enc_hook=plain)
