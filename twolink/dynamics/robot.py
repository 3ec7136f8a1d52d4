"""Robot: a checked model that answers dynamics queries, for one state or for batches on leading axes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics import pinocchio_batches as reference
from twolink.dynamics.arguments import UNIT_TOLERANCE, array, batch_shape, configuration, rows
from twolink.dynamics.compiled import Compiled
from twolink.dynamics.engine import SMALLEST, Choice
from twolink.dynamics.kernels import heyoka
from twolink.dynamics.wrench import Applied, FExt, read_wrenches
from twolink.errors import QueryError, nearest
from twolink.robots.load import Lock, load_model
from twolink.robots.model import RobotModel

Array = np.ndarray[Any, np.dtype[np.float64]]
Engine = Literal["auto", "pinocchio", "compiled"]
ENGINES = ("auto", "pinocchio", "compiled")
DIRECT = ENGINES[:2]  # those that let Pinocchio answer a single state
_FLOAT = np.dtype(np.float64)


def _total(x: Any) -> float:
    """The sum of the entries, as plain floats: not finite if any entry is not, and without NumPy's overhead.

    It may also overflow where no entry does (above 1e307); the caller then takes the slow path, which looks at each.
    """
    return float(sum(x.tolist()))


class Robot(RobotModel):
    """A robot and its equations of motion, M(q) a + h(q, v) = tau + J^T f_ext, answered by Pinocchio.

    Every query takes arrays, lists or batches: q is (..., nq), v, a and tau are (..., nv); leading axes broadcast,
    and results have the broadcast batch shape. SI units, radians, Pinocchio's conventions: quaternions are
    (x, y, z, w), a free root's velocity is in its own frame, linear part first.

    A Robot may be used from many threads at once. Queries raise QueryError, which names the argument, what was
    expected and what was given; they never return a number that is not finite.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._compiled: dict[tuple[str, ...], Compiled] = {}
        self._choice: Choice | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_compiled": {}, "_choice": None}

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        f_ext: FExt | None = None,
        method: Literal["aba", "crba"] = "aba",
        engine: Engine = "auto",
    ) -> Array:
        """Accelerations a = M(q)^-1 (tau - h(q, v) + J^T f_ext), (..., nv), rad/s^2 or m/s^2.

        method: "aba", the articulated-body algorithm (Featherstone 2008, table 7.1), O(n); "crba", the mass matrix
        by composite bodies (table 6.2), the bias by Newton-Euler, and a solve, O(n^3): a second way to the same answer.
        f_ext: wrenches on the robot by frame name, (..., 6): force [N], torque [N m], at the frame's origin, along
        the frame's own axes, or with `tl.Wrench(value, axes="world")` along the world's.
        engine: "pinocchio", "compiled" (heyoka, certified against Pinocchio), or "auto": compiled for batches from
        the size where it is faster.
        """
        if f_ext is None and method == "aba" and engine in DIRECT and not self.has_mimic and self._plain(q, v, tau):
            a: Array = pin.aba(self.model, self.data, q, v, tau)
            if isfinite(_total(q) + _total(v) + _total(tau) + _total(a)):
                return a
        if method == "aba" and self._compiles("forward_dynamics", engine, q, v, tau):
            return self.compiled().forward_dynamics(q, v, tau, f_ext)
        return self._forward(q, v, tau, f_ext, method)

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: FExt | None = None, engine: Engine = "auto"
    ) -> Array:
        """Torques tau = M(q) a + h(q, v) - J^T f_ext, (..., nv), N m or N, by recursive Newton-Euler.

        (Featherstone 2008, table 5.1.) f_ext as in `forward_dynamics`.
        """
        if f_ext is None and engine in DIRECT and self._plain(q, v, a):
            tau: Array = pin.rnea(self.model, self.data, q, v, a)
            if isfinite(_total(q) + _total(v) + _total(a) + _total(tau)):
                return tau
        if self._compiles("inverse_dynamics", engine, q, v, a):
            return self.compiled().inverse_dynamics(q, v, a, f_ext)
        states, batch = self._states(q=q, v=v, a=a)
        if f_ext is None:
            return self._finish(reference.rnea(self.model, self.data, *states.values()), batch, (self.nv,))
        states, applied, batch = self._wrenches(f_ext, batch, states)
        tau = reference.with_wrenches(pin.rnea, self.model, self.data, states["q"], states["v"], states["a"], applied)
        return self._finish(tau, batch, (self.nv,))

    def mass_matrix(self, q: ArrayLike, engine: Engine = "auto") -> Array:
        """The joint-space inertia matrix M(q), (..., nv, nv), symmetric, by composite rigid bodies."""
        algorithm = reference.crba if self.has_mimic else pin.crba
        return self._map("mass_matrix", engine, algorithm, (self.nv, self.nv), q)

    def bias(self, q: ArrayLike, v: ArrayLike, engine: Engine = "auto") -> Array:
        """h(q, v) = C(q, v) v + g(q), (..., nv): the torques that keep all accelerations zero."""
        return self._map("bias", engine, pin.nonLinearEffects, (self.nv,), q, v)

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """A Coriolis matrix C(q, v), (..., nv, nv), with C v = h - g and dM/dt - 2 C skew."""
        if self.has_mimic:  # Pinocchio 4.1 answers, with C v != h - g
            raise QueryError("there is none for mimic joints", where="coriolis", remedy="use bias - gravity_torque")
        return self._map("coriolis", "pinocchio", pin.computeCoriolisMatrix, (self.nv, self.nv), q, v)

    def gravity_torque(self, q: ArrayLike, engine: Engine = "auto") -> Array:
        """g(q), (..., nv): the torques that hold the robot still against gravity."""
        return self._map("gravity_torque", engine, pin.computeGeneralizedGravity, (self.nv,), q)

    def energy(self, q: ArrayLike, v: ArrayLike, engine: Engine = "auto") -> tuple[Array, Array]:
        """(kinetic v^T M v / 2, potential -sum m g . c), (...,) each, J. Potential is 0 at the world's origin."""
        both = self._map("energy", engine, self._energies, (2,), q, v)
        return both[..., 0], both[..., 1]

    def compiled(self, parameters: Sequence[str] = ()) -> Compiled:
        """The same queries as compiled functions, and more: see `Compiled`. Batches use it by themselves.

        parameters: physical constants to keep as run-time inputs, such as ["forearm.mass", "gravity.z"]. Functions
        are compiled when first called. Raises MissingExtraError without heyoka, QueryError for an unknown parameter.
        """
        key = tuple(parameters)
        found = self._compiled.get(key)
        return found if found is not None else self._compiled.setdefault(key, Compiled(self, key))

    def _compiles(self, name: str, engine: str, *arguments: Any) -> bool:
        """Whether the compiled function answers: when told to, or for batches of arrays where it pays."""
        if engine == "auto":
            arrays = [x for x in arguments if isinstance(x, np.ndarray) and x.ndim and x.size]
            count = max([x.size // x.shape[-1] for x in arrays], default=1)
            if count < SMALLEST or heyoka() is None:
                return False
            if self._choice is None:
                self._choice = Choice(self.compiled())

            def by_pinocchio(*states: Array) -> Any:
                return getattr(self, name)(*states, engine="pinocchio")

            return self._choice.compiled_pays(name, count, by_pinocchio)
        if engine not in ENGINES:
            raise QueryError(f"{engine!r} is unknown", where="engine", remedy=nearest(str(engine), ENGINES))
        return engine == "compiled"

    def _energies(self, model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
        if not self.has_mimic:
            kinetic = pin.computeKineticEnergy(model, data, q, v)
            return np.array([kinetic, pin.computePotentialEnergy(model, data, q)])
        pin.forwardKinematics(model, data, q)  # Pinocchio's own energies refuse mimic joints
        bodies = range(1, model.njoints)  # what is fixed to the world counts for nothing, as in Pinocchio
        moment = sum(model.inertias[j].mass * data.oMi[j].act(model.inertias[j].lever) for j in bodies)
        return np.array([v @ reference.crba(model, data, q) @ v / 2, -(model.gravity.linear @ moment)])

    def _plain(self, q: Any, v: Any, w: Any) -> bool:
        """Whether the arguments are one state as float64 arrays, so that Pinocchio can be called straight away."""
        if not (
            type(q) is type(v) is type(w) is np.ndarray
            and q.shape == self._q_shape
            and v.shape == w.shape == self._v_shape
            and q.dtype is v.dtype is w.dtype is _FLOAT
        ):
            return False
        if self._unit_entries:
            x = q.tolist()  # plain floats: five times faster than slicing arrays of two
            for i, j, k, m in self._unit_entries:
                rest = x[k] * x[k] + x[m] * x[m] if m > j else 0.0
                if not abs(x[i] * x[i] + x[j] * x[j] + rest - 1) <= UNIT_TOLERANCE:
                    return False
        return True

    def _states(self, q: ArrayLike, **others: ArrayLike) -> tuple[dict[str, Array], tuple[int, ...]]:
        """All arguments checked, broadcast and flattened to rows, and the batch shape."""
        states = {"q": configuration("q", q, self.nq, self.joints)}
        states.update({name: array(name, value, self.nv) for name, value in others.items()})
        batch = batch_shape(**states)
        return {name: rows(value, batch) for name, value in states.items()}, batch

    def _wrenches(
        self, f_ext: FExt, batch: tuple[int, ...], states: dict[str, Array]
    ) -> tuple[dict[str, Array], list[Applied], tuple[int, ...]]:
        """States and wrenches as rows of their common batch."""
        applied = read_wrenches(self.model, f_ext)
        shaped = {name: value.reshape(*batch, value.shape[-1]) for name, value in states.items()}
        whole = batch_shape(**shaped, **{f"f_ext[{i}]": w.value for i, w in enumerate(applied)})
        wide = {name: rows(value, whole) for name, value in shaped.items()}
        return wide, [replace(w, value=rows(w.value, whole)) for w in applied], whole

    def _forward(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, f_ext: FExt | None, method: str) -> Array:
        if method not in ("aba", "crba"):
            raise QueryError(f"{method!r} is unknown", argument="method", remedy=nearest(str(method), ("aba", "crba")))
        if method == "aba" and self.has_mimic:
            raise QueryError('"aba" cannot follow mimic joints', argument="method", remedy='use method="crba"')
        states, batch = self._states(q=q, v=v, tau=tau)
        if method == "crba":
            return self._forward_by_matrix(states, batch, f_ext)
        if f_ext is None:
            return self._finish(reference.aba(self.model, self.data, *states.values()), batch, (self.nv,))
        states, applied, batch = self._wrenches(f_ext, batch, states)
        a = reference.with_wrenches(pin.aba, self.model, self.data, states["q"], states["v"], states["tau"], applied)
        return self._finish(a, batch, (self.nv,))

    def _forward_by_matrix(self, states: dict[str, Array], batch: tuple[int, ...], f_ext: FExt | None) -> Array:
        applied: list[Applied] = []
        if f_ext is not None:
            states, applied, batch = self._wrenches(f_ext, batch, states)
        q, v, tau = states.values()
        still = np.zeros_like(v)
        bias = (
            reference.with_wrenches(pin.rnea, self.model, self.data, q, v, still, applied)
            if applied
            else reference.rnea(self.model, self.data, q, v, still)
        )
        inertia = self.mass_matrix(q)
        try:
            a = np.linalg.solve(inertia, (tau - bias)[..., None])[..., 0]
        except np.linalg.LinAlgError:
            raise QueryError(
                "the mass matrix is singular there", where="q", remedy="change the configuration"
            ) from None
        return self._finish(a, batch, (self.nv,))

    def _map(
        self, name: str, engine: str, algorithm: Callable[..., Array], shape: tuple[int, ...], q: Any, *velocity: Any
    ) -> Array:
        """A query of q, or of q and v: one state at once, batches compiled where it pays, or state by state."""
        v = velocity[0] if velocity else self._zero
        if engine in DIRECT and self._plain(q, v, v):
            result = algorithm(self.model, self.data, q, *velocity)
            # A mass matrix is positive definite: its diagonal bounds the rest.
            shown = result.diagonal() if name == "mass_matrix" else result.reshape(-1)
            if isfinite(_total(q) + _total(v) + _total(shown)):
                return result
        if self._compiles(name, engine, q, *velocity):
            return self.compiled().answer(name, {"q": q, **({"v": v} if velocity else {})})
        states, batch = self._states(q, **({"v": v} if velocity else {}))
        columns = list(states.values())

        def answer(i: int) -> Array:
            return algorithm(self.model, self.data, *(c[i] for c in columns))

        return self._finish(reference.each(answer, len(columns[0]), shape), batch, shape)

    def _finish(self, result: Array, batch: tuple[int, ...], shape: tuple[int, ...]) -> Array:
        """The result in its batch shape, refused unless it is finite."""
        if not np.isfinite(result).all():
            row = int(np.argwhere(~np.isfinite(result.reshape(math.prod(batch), *shape)))[0][0])
            state = f" for state {row} of the batch" if batch else ""
            raise QueryError(
                f"the result is not finite{state}",
                where=f"robot {self.name!r}",
                remedy="the values overflow, or the mass matrix is singular there",
            )
        return result if result.shape[: -len(shape)] == batch else result.reshape(*batch, *shape)


def load_robot(
    source: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    root: Literal["fixed", "free"] = "fixed",
    lock: Lock | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    mimic: bool = False,
    unphysical: Literal["refuse", "report"] = "refuse",
) -> Robot:
    """Load a robot; it is refused or reported on, never taken silently.

    source: a name (`twolink robots` lists them), a path, or the text of a URDF.
    package_dirs: folders that package://... in mesh names counts from.
    root: "fixed" to the world, or "free" (a floating base: 7 more entries in q, 6 in v).
    lock: joints to hold still, with their configuration in rad or m; they become fixed.
    gravity: the field in m/s^2, in the world's axes.
    mimic: couple mimic joints (then use method="crba"); otherwise they move on their own, and the report says so.
    unphysical: "refuse" bodies with inertias no real body has, or "report" and take them as they are.

    Raises RobotError that names the file, line, link or joint, the value, and the remedy. `robot.report` says what
    was read, ignored, repaired and assumed.
    """
    return load_model(
        Robot,
        source,
        package_dirs=package_dirs,
        root=root,
        lock=lock,
        gravity=gravity,
        mimic=mimic,
        unphysical=unphysical,
    )
