"""linearize: the linear equations of small motions around a state, or around each state of a motion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, batch_shape, configuration, instance, texts
from twolink.effects.checks import check_joints, single_joints
from twolink.effects.forces import Torque
from twolink.errors import SceneError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import accelerations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.io.text import Table
from twolink.parts.design.eigenvalues import Controllability, Stability, controllability, eigenvalues, stability_of
from twolink.parts.design.smooth import certified, derivatives_of, equations_at, freedom
from twolink.scenes import Scene
from twolink.show.figure import Plotted, plot_eigenvalues
from twolink.simulation.text import BaseResult, as_data
from twolink.simulation.trajectory_tables import coordinate_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AT_REST = 1e-9  # relative: accelerations below it are those of an equilibrium that is known to rounding


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(BaseResult, Plotted):
    """Linear equations of small motions: x' = A x + B u, with x = (dq, dv, dz) in the tangent space.

    dz are the changes of the states of effects.

    With closed loops, dq and dv are those of d independent degrees of freedom, which the others follow; else d = nv.

    It unpacks: `A, B, names = tl.linearize(...)`.

    Parameters
    ----------
    robot : Robot
        The robot with the constants that effects changed.
    q, v : ndarray (..., nq), (..., nv)
        The states; leading axes where there are several.
    t : ndarray (...)
        Their times, s.
    tau : ndarray (m,)
        The torques at the inputs, besides those of the scene, N m or N.
    A : ndarray (..., 2 d + s, 2 d + s)
    B : ndarray (..., 2 d + s, m)
    a : ndarray (..., nv + s)
        The accelerations at the states, per s^2, and the rates of the s states of effects.
    names : tuple of str
        Of the rows of A and B: "q.JOINT" for each independent degree of freedom, "v.JOINT", and "z.STATE" of effects.
    inputs : tuple of str
        Of the columns of B: joint names.
    error : float
        Bound on the error of every entry of A and B, from differences of Pinocchio's accelerations.
    independent : tuple of int
        The independent degrees of freedom.
    lift : ndarray (..., 2 nv + s, 2 d + s)
        The changes (dq, dv) of all degrees of freedom by x, and of the s states of effects.
    """

    robot: Robot
    q: np.ndarray
    v: np.ndarray
    t: np.ndarray
    tau: np.ndarray
    A: np.ndarray
    B: np.ndarray
    a: np.ndarray
    names: tuple[str, ...]
    inputs: tuple[str, ...]
    error: float
    independent: tuple[int, ...]
    lift: np.ndarray

    def __iter__(self) -> Iterator[Any]:
        return iter((self.A, self.B, self.names))

    def state(self, i: int) -> "Linearization":
        """The linearization about the i-th of several states."""
        values = {name: getattr(self, name)[i] for name in ("q", "v", "t", "A", "B", "a", "lift")}
        return replace(self, **values)

    @property
    def is_equilibrium(self) -> bool:
        """True if the state is at rest and stays there, to rounding."""
        one = self._one("is_equilibrium")
        scale = 1.0 + float(np.abs(one.A).max(initial=0.0))
        return not one.v.any() and float(np.abs(one.a).max(initial=0.0)) <= AT_REST * scale

    @cached_property
    def _eigenvalues(self) -> tuple[np.ndarray, np.ndarray]:
        one = self._one("eigenvalues")
        return eigenvalues(one.A, len(one.A) * one.error)

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A (2 d,), 1/s, that with the largest real part first."""
        return self._eigenvalues[0]

    @property
    def eigenvalue_errors(self) -> np.ndarray:
        """Bounds on the errors of the eigenvalues (2 d,), 1/s, from that of A."""
        return self._eigenvalues[1]

    @cached_property
    def stability(self) -> Stability:
        """Of the equilibrium, as far as its eigenvalues decide.

        "asymptotically stable": all eigenvalues are left of the imaginary axis. "stable": none is right of it, forces
        restore and friction does not feed. "centre": forces restore, and there is no friction. "saddle", "unstable":
        some are right of it, and some or none left of it. "unknown": one is nearer to the axis than its error. Where
        forces have a potential, a centre is stable (Lagrange and Dirichlet's theorem).

        Raises SceneError where the state is no equilibrium, code "not-equilibrium".
        """
        if not self.is_equilibrium:
            size = float(np.abs(self.a).max(initial=0.0))
            raise SceneError(f"this state is no equilibrium: its acceleration is {size:.2g}", where="stability",
                             remedy="tl.equilibria(scene) finds them", code="not-equilibrium")  # fmt: skip
        d, nv = len(self.independent), self.robot.nv
        mass = self.lift[:nv, :d].T @ self.robot.mass_matrix(self.q) @ self.lift[:nv, :d]
        return stability_of(self.eigenvalues, self.eigenvalue_errors, mass, self.A[d:], self.error)

    @cached_property
    def controllability(self) -> Controllability:
        """The number of directions of the state that the inputs reach, and the singular values that decided."""
        one = self._one("controllability")
        return controllability(one.A, one.B, one.error)

    def table(self) -> Table:
        """The eigenvalues: real and imaginary part, error, frequency and damping ratio."""
        rows = []
        for z, error in zip(self.eigenvalues, self.eigenvalue_errors, strict=True):
            size = abs(z)
            turning = abs(z.imag) > error
            rows.append((float(z.real), float(z.imag), float(error), size / (2 * np.pi) if turning else None,
                         float(-z.real / size) if size > error else None))  # fmt: skip
        return Table(("real 1/s", "imaginary 1/s", "error", "frequency Hz", "damping ratio"), tuple(rows))

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON; of several states, a list of them."""
        if self.A.ndim != 2:
            return {"states": [self.state(i).to_dict() for i in range(len(self.A))]}
        names = ("q", "v", "t", "tau", "a", "A", "B", "names", "inputs", "error", "eigenvalues", "eigenvalue_errors")
        return {name: as_data(getattr(self, name)) for name in names} | {
            "equilibrium": self.is_equilibrium, "stability": self.stability if self.is_equilibrium else None,
            "controllable": self.controllability.rank if self.inputs else 0,
        }  # fmt: skip

    def _figure(self) -> "Figure":
        return plot_eigenvalues(f"{self.robot.name}: eigenvalues", {"": (self.eigenvalues, self.eigenvalue_errors)})

    def _one(self, name: str) -> "Linearization":
        if self.A.ndim != 2:
            raise SceneError(f"there are {len(self.A)} states", where=name, remedy="ask for one: .state(i)")
        return self

    def __str__(self) -> str:
        rows, columns = self.B.shape[-2:]
        head = f"{self.robot.name}: A {rows} x {rows}, B {rows} x {columns}, errors of entries <= {self.error:.1e}"
        lines = [head, f"states {', '.join(self.names)}", f"inputs {', '.join(self.inputs) or 'none'}"]
        if self.A.ndim != 2:
            return "\n".join([*lines, f"about {len(self.A)} states; .state(i) has one"])
        numbers = ", ".join(f"{x:.6g}" for x in self.q)
        moving = f", v = {', '.join(f'{x:.6g}' for x in self.v)}" if self.v.any() else ", at rest"
        what = self.stability if self.is_equilibrium else f"no equilibrium, |a| = {np.abs(self.a).max():.3g}"
        lines += [f"about q = {numbers}{moving}: {what}", str(self.table())]
        return "\n".join([*lines, str(self.controllability)] if self.inputs else lines)

    __repr__ = __str__


def linearize(
    scene: Scene,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    t: ArrayLike = 0.0,
    inputs: Sequence[str] | None = None,
    tau: ArrayLike | None = None,
) -> Linearization:
    """The linear equations of small motions around a state, or around each state of a motion.

        dq' = dv - ad(v) dq,   dv' = f_q dq + f_v dv + f_u du        (a = f(t, q, v, u), dq in the tangent space)

    Parameters
    ----------
    scene : Scene
        All its effects count.
    q, v : array_like (..., nq), (..., nv), optional
        The state; by default the scene's own, and at rest where q alone is given. With a leading axis the states of a
        motion, as `run.q` and `run.v`.
    t : float or array_like (...)
        The time, s, for effects that depend on it; `run.t` along a motion.
    inputs : sequence of str, optional
        The actuated joints, whose torques are the inputs u; by default all with one degree of freedom.
    tau : array_like (m,), optional
        Torques at the inputs that act besides the scene's effects, N m or N; 0 by default.

    Returns
    -------
    Linearization
        Unpacks as A, B, names; prints eigenvalues, stability and controllability.

    Raises
    ------
    SceneError
        An argument does not fit; the forces are not smooth at a state, since friction, a stop or a contact holds there
        (code "not-differentiable"); or its loops are in a singular position (code "singular-position").
    CertificationError
        The derivatives disagree with differences of Pinocchio's accelerations.

    Notes
    -----
    Loops are closed first, as `simulate` closes them. The independent degrees of freedom are chosen so that the others
    depend on them as little as possible; A is that of motions which the loops allow.

    States of effects are those that the effects begin with at (q, v), along a motion too: a run's own are not followed.

    ad(v) dq is 0 for joints with one degree of freedom. For a free root it appears because tangent vectors are along
    the moving body's axes: Sola, Deray, Atchuthan, A micro Lie theory for state estimation in robotics, 2018.
    """
    joints = _inputs(instance(scene, Scene, "scene", SceneError), inputs)
    states, speeds, times, batch = _states(scene, q, v, t)
    torques = np.zeros(len(joints)) if tau is None else array("tau", tau, len(joints))
    if torques.ndim != 1:
        raise SceneError(f"expected {len(joints)} numbers, got an array of shape {torques.shape}", argument="tau",
                         remedy="give one for each input")  # fmt: skip
    equations = driven(scene, joints, torques)
    here = [equations_at(equations, *state) for state in zip(times.tolist(), states, speeds, strict=True)]
    groups: dict[str, list[int]] = {}
    for i, own in enumerate(here):
        groups.setdefault(own.content, []).append(i)
    nv, x = scene.robot.nv, np.array([own.start for own in here]).T
    tangent, states_of_effects = equations.space.tangent, equations.space.states
    if len({own.constraints and own.constraints.loops for own in here}) > 1:
        raise SceneError("loops hold at some of these states, and are released at others", argument="t",
                         remedy="ask for those before and after the release apart")  # fmt: skip
    independent, lift = freedom(here[0], times, x)
    rows_of_rates = equations.space.moving - equations.space.nq
    derivatives = np.empty((len(times), rows_of_rates, tangent + len(joints)))
    a, error = np.empty((len(times), rows_of_rates)), 0.0
    for places in groups.values():
        own, at = here[places[0]], times[places]
        a[places], derivatives[places] = derivatives_of(accelerations, own, at, x[:, places])
        error = max(error, certified(own, at, x[:, places], derivatives[places]))
    top = np.broadcast_to(np.eye(nv, tangent + len(joints), nv), (len(times), nv, tangent + len(joints))).copy()
    top[:, :, :nv] -= _adjoint(scene.robot, x[equations.space.v_rows].T)
    whole = np.concatenate([top, derivatives], axis=1)
    rows = [*independent, *(nv + k for k in independent), *range(2 * nv, tangent)]

    def shaped(values: np.ndarray) -> np.ndarray:
        return values.reshape((*batch, *values.shape[1:]))

    q, v = equations.space.rows(x)
    names = (*state_names(scene.robot), *(f"z.{name}" for name in states_of_effects))
    return Linearization(
        here[0].robot, shaped(q), shaped(v), shaped(times), torques, shaped(whole[:, rows, :tangent] @ lift),
        shaped(whole[:, rows, tangent:]), shaped(a), tuple(names[k] for k in rows), joints,
        error * float(np.abs(lift).sum(axis=1).max(initial=1.0)), independent, shaped(lift),
    )  # fmt: skip


def driven(scene: Scene, joints: Sequence[str], tau: np.ndarray) -> Equations:
    """The scene's equations with torques at some joints, which are their parameters."""
    effects, names = list(scene.effects), []
    if joints:
        effects.append(Torque(dict(zip(joints, tau.tolist(), strict=True))))
        names = [f"effects.{len(scene.effects)}.inputs.{joint}" for joint in joints]
    equations = equations_of(scene.with_effects(effects), names)
    equations.require_motion()
    return equations


def state_names(robot: Robot) -> tuple[str, ...]:
    """The names of the entries of (dq, dv)."""
    return tuple(f"{letter}.{name}" for letter in "qv" for name in coordinate_names(robot, "v"))


def _inputs(scene: Scene, inputs: Sequence[str] | None) -> tuple[str, ...]:
    """The actuated joints."""
    if inputs is None:
        return tuple(single_joints(scene.robot))
    joints = texts(inputs, "inputs", SceneError, "give the names of joints")
    try:
        if joints:
            check_joints(joints, scene.robot, "inputs", dofs=True)
    except SceneError as error:
        raise error.at("inputs", SceneError, argument="inputs") from None
    return tuple(dict.fromkeys(joints))


def _states(
    scene: Scene, q: ArrayLike | None, v: ArrayLike | None, t: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[int, ...]]:
    """(q (n, nq), v (n, nv), t (n,), shape of the batch)."""
    robot = scene.robot
    states = configuration("q", scene.q if q is None else q, robot.nq, robot.joints)
    default = scene.v if q is None else np.zeros(robot.nv)
    speeds, times = array("v", default if v is None else v, robot.nv), array("t", t, None)
    batch = batch_shape(q=states, v=speeds, t=times[..., None])
    if len(batch) > 1 or batch == (0,):
        raise SceneError(f"expected one state, or some along one leading axis, got {batch}", argument="q",
                         remedy="reshape it, or give at least one")  # fmt: skip
    count = int(np.prod(batch))
    states, speeds = (np.broadcast_to(x, (*batch, x.shape[-1])).reshape(count, -1) for x in (states, speeds))
    return states, speeds, np.broadcast_to(times, batch).reshape(count), batch


def _adjoint(robot: Robot, v: np.ndarray) -> np.ndarray:
    """ad(v) (n, nv, nv): the commutator of tangent vectors with velocities v (n, nv), joint by joint."""
    out = np.zeros((len(v), robot.nv, robot.nv))
    for joint in robot.joints:
        entries = {"free-flyer": [0, 1, 2, 3, 4, 5], "planar": [0, 1, 5], "quaternion": [3, 4, 5]}.get(joint.kind)
        if entries is None:
            continue
        for i, speed in enumerate(v):
            twist = np.zeros(6)
            twist[entries] = speed[joint.v]
            out[i, joint.v, joint.v] = pin.Motion(twist).action[np.ix_(entries, entries)]
    return out
