"""Effects that users write: they are tried once on symbols, so that mistakes are named before anything is compiled.

A formula of an effect is run by NumPy, counted, differentiated and compiled. What works in NumPy alone, such as `if`,
`**` or np.sin, must not be in it, nor what changes from call to call, such as noise. The trial also gives the formula's
fingerprint: a class that is defined again under its name has other code.
"""

import hashlib
import inspect
import itertools
import operator
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.motion import GROUND, KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.tape import Symbol, Tape
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, Loads, check_name
from twolink.effects.inputs import with_pieces
from twolink.errors import SceneError, TwolinkError

Outputs = dict[str, list[str]]  # by joint
_SERIAL = itertools.count()
_PACKAGE = str(Path(__file__).parents[1]) + os.sep
_ARITHMETIC = {"add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv}
_NAMESPACE = ("sin", "cos", "sqrt", "exp", "tanh", "less", "where")  # what xp has in every use
_CHOICE = "write motion.xp.where(motion.xp.less(a, b), value_if_less, value_if_not)"
_INSTEAD = {
    "power": "write products, such as q * q * q",
    "absolute": "write motion.xp.sqrt(q * q + epsilon), which is smooth at 0",
    "tan": "write motion.xp.sin(q) / motion.xp.cos(q)",
    **dict.fromkeys(("greater", "less", "greater_equal", "less_equal", "maximum", "minimum", "sign", "clip"), _CHOICE),
    **{name: f"write motion.xp.{name}" for name in ("sin", "cos", "sqrt", "exp", "tanh")},
}


def check_own_methods(effect: Effect) -> None:
    """Require methods with the arguments that they are called with. Raises SceneError."""
    for name in ("act", "change", "check", "breaks", "states"):
        base, own = (list(inspect.signature(getattr(kind, name)).parameters) for kind in (Effect, type(effect)))
        if len(own) != len(base):
            remedy = f"write def {name}({', '.join(base)})"
            raise SceneError(f"{name} takes ({', '.join(own)})", where=name, remedy=remedy, code="own-effect")


def check_own_formula(effect: Effect, robot: Robot) -> None:
    """Require a formula that can be compiled, the same each time. Raises SceneError that names what to write."""
    if type(effect).__module__.startswith("twolink.") or type(effect).act is Effect.act:
        return
    tape, formulas = _trial(effect, robot.model)
    _require_repeatable(effect, robot, formulas)
    if effect.analytic and any(what in ("less", "less_equal", "where") for what, *_ in tape.operations):
        raise SceneError("act chooses by motion.xp.where, so that the motion has kinks", where="analytic",
                         remedy="write analytic: ClassVar[bool] = False in the class")  # fmt: skip


def has_own(effect: Effect) -> bool:
    """True if the effect, or one inside it, is one of a user's own."""
    inside = getattr(effect, "of", None)
    return not type(effect).__module__.startswith("twolink.") or (isinstance(inside, Effect) and has_own(inside))


def formula_fingerprint(effect: Effect, model: pin.Model) -> str:
    """A digest of what an effect of a user's own computes for a robot, or one inside; "" of one of twolink's."""
    if not has_own(effect):
        return ""
    return hashlib.sha256(repr(_trial(effect, model)[1]).encode()).hexdigest()


def _trial(effect: Effect, model: pin.Model) -> tuple[Tape, Outputs]:
    """The operations of `act`, and what it adds as formulas. Raises SceneError."""
    tape = _StrictTape()
    q, v = ([tape.variable() for _ in range(count)] for count in (model.nq, model.nv))
    motion = _StrictMotion(model, mechanism(model), q, v, tape.variable(), tape)
    motion.states = {name: tape.variable() for name in effect.states(motion)}
    return tape, _outputs(effect, motion, tape.formula)


def _require_repeatable(effect: Effect, robot: Robot, formulas: Outputs) -> None:
    """Require that `act` adds the same when it is called again, by numbers and as formulas. Raises SceneError.

    What it drew at random or kept from an earlier call would be constants of the compiled code.
    """
    model = robot.model

    def values(shift: float) -> Outputs:
        """The outputs of `act` at a state."""
        q, v = robot.integrate(robot.neutral, np.full(model.nv, shift)), np.full(model.nv, -shift)
        motion = KinematicState(model, mechanism(model), list(q), list(v), shift, Numbers)
        motion.states = dict.fromkeys(effect.states(motion), shift)
        with np.errstate(all="ignore"):
            return _outputs(effect, motion, _number)

    before, _, after = values(0.3), values(0.7), values(0.3)
    _require_same(effect, before, after)
    _require_same(effect, formulas, _trial(effect, model)[1])


def _require_same(effect: Effect, first: Outputs, second: Outputs) -> None:
    for joint in first:
        if first[joint] != second[joint]:
            what = f"act of {type(effect).__name__} gives another load on {joint} each time it is called"
            remedy = ("let it depend on motion.q, motion.v, motion.t and the fields of the effect alone; "
                      "noise is a table of samples, tl.effects.Sampled")  # fmt: skip
            raise SceneError(what, where="act", remedy=remedy, code="not-repeatable")


def _outputs(effect: Effect, motion: KinematicState, read: Callable[[Any], str]) -> Outputs:
    """The outputs of `act`, read as text: by joint its torques, and the wrench on its body. Raises SceneError."""
    model, loads = motion.model, _StrictLoads(motion)
    act: Callable[..., object] = with_pieces(effect, lambda _: 1.0).act
    try:
        returned = act(motion, loads)
        added = [[*loads.tau[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]], *loads.wrenches.get(i, ())]
                 for i in range(1, model.njoints)]  # fmt: skip
        outputs = {name: [read(x) for x in own] for name, own in zip(list(model.names)[1:], added, strict=True)}
        outputs |= {f"state {name}": [read(rate)] for name, rate in loads.rates.items()}
    except TwolinkError:
        raise
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        last = next((f for f in reversed(frames) if not f.filename.startswith(_PACKAGE)), frames[-1])
        what = f"act fails at line {last.lineno} of {last.filename}: {type(error).__name__}: {error}"
        remedy = "write formulas with + - * / and the functions of motion.xp"
        raise SceneError(what, where="act", remedy=remedy, code="own-effect") from error
    odd = sorted(set(loads.rates) ^ set(motion.states))
    if odd:
        what = f"act gives {'the' if odd[0] in loads.rates else 'no'} rate of {odd[0]!r}"
        remedy = f"states and loads.rates have the same names: {', '.join(motion.states) or 'none'}"
        raise SceneError(what, where="act", remedy=remedy, code="own-effect")
    if returned is not None:
        remedy = "add torques by loads.torque(dof, value)"
        raise SceneError("act returns a value", where="act", remedy=remedy, code="own-effect")
    return outputs


def _number(x: Any) -> str:
    """A number with all its digits. A symbol, kept from an earlier call, is unlike any other."""
    return f"symbol {next(_SERIAL)}" if isinstance(x, Symbol) else repr(float(np.squeeze(x)))


def _refusal(what: str, instead: str) -> SceneError:
    return SceneError(f"{what} cannot be compiled", where="act", remedy=instead, code="own-effect")


def _refuses(what: str, instead: str) -> Callable[..., Any]:
    """A method of symbols that is not for formulas."""

    def method(*_: Any) -> Any:
        raise _refusal(what, instead)

    return method


class _Strict(Symbol):
    """A symbol that names what is not for formulas, where Python would take it for a number or for true."""

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]

    __pow__ = __rpow__ = _refuses("a ** b", _INSTEAD["power"])
    __bool__ = _refuses("a choice by `if`, `and`, `or`, `min` or `max`", _CHOICE)
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuses("a comparison", _CHOICE)
    __abs__ = _refuses("abs(...)", _INSTEAD["absolute"])
    __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = _refuses("% or //", "write sines and cosines of the angle")
    __float__ = __int__ = _refuses(
        "a value as a number, as the module math takes it,",
        f"write motion.xp.NAME(...), with NAME one of {', '.join(_NAMESPACE)}",
    )

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's numbers times a symbol are as Python's; its functions are not for formulas."""
        name = ufunc.__name__
        if name in _ARITHMETIC and method == "__call__" and not any(np.ndim(x) for x in inputs):
            return _ARITHMETIC[name](*(float(x) if isinstance(x, np.generic) else x for x in inputs))
        raise _refusal(
            f"np.{name}", _INSTEAD.get(name, f"write it with + - * / and motion.xp's {', '.join(_NAMESPACE)}")
        )


class _StrictTape(Tape):
    """A tape whose symbols are strict."""

    symbol = _Strict

    def __init__(self) -> None:
        super().__init__()
        self._formulas: list[str] = []  # by the number of the symbol

    def formula(self, x: Any) -> str:
        """A digest of the operations that made a symbol, or a number with all its digits."""
        if not isinstance(x, Symbol):
            return repr(float(x))
        for key in range(len(self._formulas), len(self.operations)):  # operands have smaller numbers
            what, *parts = self.operations[key]
            parts = [float(key)] if what == "variable" else parts
            text = repr([what, *(part if isinstance(part, float) else self._formulas[part] for part in parts)])
            self._formulas.append(hashlib.sha256(text.encode()).hexdigest())
        return self._formulas[x.key]

    def __getattr__(self, name: str) -> Any:
        raise _refusal(f"motion.xp.{name}", f"motion.xp has {', '.join(_NAMESPACE)}")


class _StrictMotion(KinematicState):
    """A motion that knows which joints and frames there are."""

    def frame(self, frame: str) -> Any:
        """As of a motion. Raises SceneError for an unknown frame."""
        check_name(frame, (*(f.name for f in self.model.frames), GROUND), "act", "frame")
        return super().frame(frame)

    def coordinate(self, joint: str) -> tuple[int, int]:
        """As of a motion. Raises SceneError for an unknown joint."""
        check_name(joint, list(self.model.names)[1:], "act", "joint")
        return super().coordinate(joint)

    def dofs(self, joint: str) -> range:
        """As of a motion. Raises SceneError for an unknown joint."""
        check_name(joint, list(self.model.names)[1:], "act", "joint")
        return super().dofs(joint)


class _StrictLoads(Loads):
    """Loads that know which degrees of freedom there are."""

    def torque(self, dof: int, value: Any) -> None:
        """As of loads. Raises SceneError for what is no degree of freedom."""
        if isinstance(dof, str):
            remedy = f"write entry, dof = motion.coordinate({dof!r}) and loads.torque(dof, value)"
            raise SceneError(f"expected the number of a degree of freedom, got {dof!r:.60}", where="act", remedy=remedy,
                             code="own-effect")  # fmt: skip
        if not 0 <= dof < len(self.tau):
            raise SceneError(f"there is no degree of freedom {dof}", where="act", code="own-effect",
                             remedy=f"the robot has 0 to {len(self.tau) - 1}")  # fmt: skip
        super().torque(dof, value)
