"""The equations that hold around a state, where forces are smooth there."""

from dataclasses import replace

import numpy as np

from twolink.algorithms.operation_count import Tape
from twolink.errors import SceneError
from twolink.integrate.assembly import assembled
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import accelerations
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire_timed, guards_of
from twolink.integrate.scene_equations import with_parameters
from twolink.integrate.state import Array


def equations_at(equations: Equations, t: float, q: Array, v: Array) -> Equations:
    """The equations of the mode that holds at a state, which is their start, loops closed; with the same parameters.

    Raises SceneError, code "not-differentiable", where a joint is held, bodies touch, or an event is due.
    """
    x = np.concatenate([q, v])
    if equations.constraints is not None:
        x = assembled(equations.constraints, x)
    if not equations.has_events:
        return replace(equations, start=np.concatenate([x, equations.layout.numbers_at(t)]))
    run = RunState(replace(equations, start=np.concatenate([x, equations.start[equations.moving :]])), t, 0.0)
    run.require_room("the state")
    run.resolve_mode()
    fire_timed(run)
    run.resolve_mode()
    if run.ended or not np.array_equal(run.x, x):
        raise _not_smooth("an event changes the state there")
    _require_no_contact(run)
    state = run.mode_state
    for guard in guards_of(run, state.evaluate()):
        if guard.at_zero:
            kind, number = guard.key
            raise _not_smooth(f"{_name(run, kind, number)} is where its force changes abruptly")
    start = state.full_state()
    return replace(with_parameters(state.own.equations, equations.parameters), start=start)


def depends_on_time(equations: Equations) -> bool:
    """Whether accelerations depend on time for a given state, by tables or formulas of time."""
    if any(True for _ in equations.layout.tables):
        return True
    tape = Tape()
    t = tape.variable()
    x = [tape.variable() for _ in range(equations.space.size)]
    rows = accelerations(replace(equations, parameters=()), equations.mechanism, t, x, tape)
    return any(t.key in tape.inputs(row) for row in rows)


def _require_no_contact(run: RunState) -> None:
    """Require that nothing holds a joint and no bodies touch."""
    held = [run.system.names[k] for k in sorted(run.mode.locked)]
    held += [contact.name for contact, mode in zip(run.system.contacts, run.mode.contacts, strict=True)
             if mode != "free"]  # fmt: skip
    if held:
        raise _not_smooth(f"{', '.join(held)} is held by friction, a stop or a contact")


def _not_smooth(why: str) -> SceneError:
    return SceneError(f"the forces have no derivatives at this state: {why}", where="q, v",
                      remedy="ask for a state inside one mode, or leave that effect out: scene.without(index)",
                      code="not-differentiable")  # fmt: skip


def _name(run: RunState, kind: str, number: int) -> str:
    """What a guard watches."""
    if kind == "stop":
        return f"joint {run.system.stops[number].name!r} at its stop"
    if kind in ("impact", "leave", "slide", "roll"):
        return f"contact {run.system.contacts[number].name!r}"
    if kind == "trigger":
        return f"{run.system.triggers[number][1].name!r}"
    return f"joint {run.system.names[number]!r}"
