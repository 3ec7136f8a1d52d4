"""Robot: a checked model that answers dynamics queries, for one state or for batches on leading axes."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import Shape, frame_names
from twolink.algorithms.recursions import Axes
from twolink.dynamics import configurations, pinocchio_queries
from twolink.dynamics.arguments import FExt, by_joint, one_of, states_of
from twolink.dynamics.compiled import AXES, Compiled
from twolink.dynamics.engine import ENGINES, compiled_from
from twolink.dynamics.pinocchio_queries import by_axes, shows_all
from twolink.dynamics.queries import ARGUMENTS, Algorithm, Array, query
from twolink.dynamics.regressors import regressor_names, regressor_query, regressor_values
from twolink.errors import CertificationError
from twolink.io.text import facts_html
from twolink.native.library import library
from twolink.robots.checks import mass_matrix_by_columns
from twolink.robots.joint_layout import UNIT_TOLERANCE
from twolink.robots.load_report import LoadReport
from twolink.robots.model import RobotModel, Visuals

Engine = Literal["auto", "pinocchio", "compiled"]
_BY_PINOCCHIO = ("auto", "pinocchio")  # the engines that let Pinocchio answer a single state
_FLOAT = np.dtype(np.float64)
_SQUARE: Shape = ("nv", "nv")
_UNCOUPLED, _BY_BIAS = "load it with mimic=False", "use bias - gravity_torque"


def _derivatives(of: str, *by: str) -> dict[str, tuple[Shape, str]]:
    """The results of a query for derivatives."""
    return {f"d{of}_d{x}": (_SQUARE, f"of {of} by {x}") for x in by}


class Robot(RobotModel):
    """A robot and its equations of motion, M(q) a + h(q, v) = tau + J^T f_ext.

    Queries take arrays or lists: q is (..., nq); v, a and tau are (..., nv). Leading axes broadcast, and results have
    the broadcast batch shape. SI units, radians, Pinocchio's conventions: quaternions are (x, y, z, w), the velocity
    of a free root is in its own frame, spatial vectors are linear then angular.

    Pinocchio answers single states and small batches; compiled functions, certified against Pinocchio, answer large
    batches (`engine`: "auto" chooses by the query, nv and the number of states; "pinocchio" and "compiled" decide).

    A Robot may be used from many threads at once.

    Parameters
    ----------
    name : str
        The robot's name.
    model : pin.Model
        The checked model. It is shared and must not be changed.
    report : LoadReport
        What is suspicious, and what loading read, ignored, repaired and assumed.
    visuals : Visuals
        What is needed to draw the robot.

    Raises
    ------
    QueryError
        By every query, for an argument that it cannot use or a result that is not finite. The error names the argument,
        what was expected and what came.
    """

    # From the room `exchange`, which stands above; `twolink/__init__.py` has the table.
    export_c: ClassVar[Callable[..., tuple[Path, Path]]]
    export_urdf: ClassVar[Callable[..., Path]]
    export_mjcf: ClassVar[Callable[..., Path]]

    def __init__(self, name: str, model: pin.Model, report: LoadReport, visuals: Visuals) -> None:
        super().__init__(name, model, report, visuals)
        self._compiled: dict[tuple[str, ...], Compiled] = {}
        self._queries: dict[str, Algorithm] = {}
        self._shown: dict[str, bool] = {}

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self._summary().items())
        return f"<Robot {self.name!r}: {facts}>"

    def _repr_html_(self) -> str:
        return facts_html(f"Robot {self.name}", {name: [value] for name, value in self._summary().items()})

    def _summary(self) -> dict[str, str]:
        shown = ", ".join(self.joint_names[:8]) + (", ..." if len(self.joint_names) > 8 else "")
        doubts = f", {len(self.report.suspicious)} suspicious" if self.report.suspicious else ""
        return {
            "nq": str(self.nq),
            "nv": str(self.nv),
            "joints": f"{len(self.joint_names)} ({shown})",
            "mass": f"{self.mass:.4g} kg",
            "source": self.report.source,
            "remarks": f"{len(self.report.findings) - len(self.report.read)}{doubts} (see .report)",
        }

    @query({"a": (("nv",), "rad/s^2 or m/s^2")}, pin.aba, parallel=pin.abaInParallel, join=np.hstack)
    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        f_ext: FExt | None = None,
        method: Literal["auto", "aba", "crba"] = "auto",
        engine: Engine = "auto",
    ) -> Array:
        """Accelerations a = M(q)^-1 (tau - h(q, v) + J^T f_ext).

        Parameters
        ----------
        q, v, tau : array_like, (..., nq), (..., nv), (..., nv)
            Configuration [rad, m], velocity [rad/s, m/s] and joint torque or force [N m, N].
        f_ext : mapping of frame name to wrench, optional
            Wrenches on the robot, (..., 6): force [N], torque [N m], at the frame's origin, along the frame's own
            axes, or with `tl.Wrench(value, axes="world")` along the world's.
        method : {"auto", "aba", "crba"}
            "aba": the articulated-body algorithm, O(n), which cannot follow mimic joints. "crba": the mass matrix by
            composite bodies, the bias by Newton-Euler, and a linear solve, O(n^3); an independent second way. "auto":
            "aba", and with mimic joints "crba". Compiled functions, which answer all but "crba", take the one with
            fewer operations.
        engine : {"auto", "pinocchio", "compiled"}
            Who answers; see the class.

        Returns
        -------
        ndarray, (..., nv)
            Accelerations, rad/s^2 or m/s^2.

        Raises
        ------
        QueryError
            For arguments of a wrong shape or value, an unknown frame, or a result that is not finite.

        References
        ----------
        Featherstone 2008, "Rigid Body Dynamics Algorithms", tables 7.1 and 6.2.
        """
        if method in ("auto", "aba") and f_ext is None and not self.has_mimic:
            shown = self._shown.get("forward_dynamics") or shows_all(self, self._shown, "forward_dynamics")
            if shown and engine in _BY_PINOCCHIO and self._is_state(q, v, tau):
                a: Array = pin.aba(self.model, self.data, q, v, tau)
                if isfinite(sum(a.tolist())):
                    return a  # as `_answer`, a tenth faster (scripts.benchmarks.kernels --single)
            return self._answer("forward_dynamics", engine, q, v, tau)
        pinocchio_queries.require_method(method, self.has_mimic)
        if method != "crba" and self._is_compiled("forward_dynamics", engine, q, v, tau):
            return self.compiled().forward_dynamics(q, v, tau, f_ext)
        method = "crba" if self.has_mimic else method
        return pinocchio_queries.answer(self, self._query("forward_dynamics"), (q, v, tau), f_ext, method)

    @query({"tau": (("nv",), "N m or N")}, pin.rnea, parallel=pin.rneaInParallel, join=np.hstack)
    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: FExt | None = None, engine: Engine = "auto",
        losses: bool = False,
    ) -> Array:  # fmt: skip
        """Joint torques tau = M(q) a + h(q, v) - J^T f_ext, by the recursive Newton-Euler algorithm.

        With losses tau = M(q) a + h(q, v) - J^T f_ext + d v + f sign(v), which the motors of the robot must give.

        Parameters
        ----------
        q, v, a : array_like, (..., nq), (..., nv), (..., nv)
            Configuration, velocity and acceleration.
        f_ext : mapping of frame name to wrench, optional
            As in `forward_dynamics`.
        engine : {"auto", "pinocchio", "compiled"}
            Who answers; see the class.
        losses : bool
            Add the damping d [N m s/rad, N s/m] and the friction f [N m, N] of the file (<dynamics damping friction>).
            At v = 0 the friction is 0, where a real joint may need any torque from -f to f. Joints without them get
            0; `report` names them.

        Returns
        -------
        ndarray, (..., nv)
            Joint torques and forces, N m or N.

        Raises
        ------
        QueryError
            As `forward_dynamics`; of losses, also with mimic joints, whose own losses are not known to the model.

        References
        ----------
        Featherstone 2008, table 5.1.
        """
        if losses is not False:
            return pinocchio_queries.with_losses(self, losses, self.inverse_dynamics(q, v, a, f_ext, engine), v)
        if f_ext is None:
            shown = self._shown.get("inverse_dynamics") or shows_all(self, self._shown, "inverse_dynamics")
            if shown and engine in _BY_PINOCCHIO and self._is_state(q, v, a):
                tau: Array = pin.rnea(self.model, self.data, q, v, a)
                if isfinite(sum(tau.tolist())):
                    return tau
            return self._answer("inverse_dynamics", engine, q, v, a)
        if self._is_compiled("inverse_dynamics", engine, q, v, a):
            return self.compiled().inverse_dynamics(q, v, a, f_ext)
        return pinocchio_queries.answer(self, self._query("inverse_dynamics"), (q, v, a), f_ext)

    @query({"M": (_SQUARE, "kg m^2 or kg")}, pin.crba, mimic=mass_matrix_by_columns)
    def mass_matrix(self, q: ArrayLike, engine: Engine = "auto") -> Array:
        """The joint-space inertia matrix M(q), (..., nv, nv), symmetric.

        Notes
        -----
        By composite rigid bodies (Featherstone 2008, table 6.2); with mimic joints column by column from the
        Newton-Euler algorithm.
        """
        return self._answer("mass_matrix", engine, q)

    @query({"h": (("nv",), "N m or N")}, pin.nonLinearEffects, join=np.hstack)
    def bias(self, q: ArrayLike, v: ArrayLike, engine: Engine = "auto") -> Array:
        """h(q, v) = C(q, v) v + g(q), (..., nv): the torques that keep all accelerations zero, N m or N."""
        return self._answer("bias", engine, q, v)

    @query({"C": (_SQUARE, "N m s or N s/m")}, pin.computeCoriolisMatrix, mimic=_BY_BIAS, anywhere=True)
    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """A Coriolis matrix C(q, v), (..., nv, nv), with C v = h - g and dM/dt - 2 C skew-symmetric.

        Raises
        ------
        QueryError
            With mimic joints, for which Pinocchio has none.
        """
        return self._answer("coriolis", "pinocchio", q, v)

    @query({"g": (("nv",), "N m or N")}, pin.computeGeneralizedGravity, join=np.hstack)
    def gravity_torque(self, q: ArrayLike, engine: Engine = "auto") -> Array:
        """g(q), (..., nv): the torques that hold the robot at rest against gravity, N m or N."""
        return self._answer("gravity_torque", engine, q)

    @query(
        {"kinetic": ((), "J"), "potential": ((), "J")},
        pinocchio_queries.energies,
        join=partial(np.sum, axis=0),
        mimic=pinocchio_queries.energies_with_mimic,
    )
    def energy(self, q: ArrayLike, v: ArrayLike, engine: Engine = "auto") -> tuple[Array, Array]:
        """(kinetic v^T M v / 2, potential -sum m g . c), (...,) each, J. The potential is 0 at the world's origin."""
        both = self._answer("energy", engine, q, v)
        return both[..., 0], both[..., 1]

    @query({"c": ((3,), "m")}, pinocchio_queries.centre_of_mass)
    def centre_of_mass(self, q: ArrayLike) -> Array:
        """The centre of mass c = sum m_i c_i / sum m_i of all bodies that can move, (..., 3), m, in the world.

        Links that are fixed to the world do not count.
        """
        return self._answer("centre_of_mass", "pinocchio", q)

    @query({"momentum": ((6,), "kg m/s, then kg m^2/s")}, pinocchio_queries.momentum)
    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The robot's momentum (p, L), (..., 6), along the world's axes, L about the centre of mass c.

        p = sum m_i c_i' [kg m/s]; L = sum (c_i - c) x m_i c_i' + I_i w_i [kg m^2/s]. The angular momentum about the
        world's origin is L + c x p.

        Parameters
        ----------
        q, v : array_like, (..., nq), (..., nv)
            Configuration and velocity.

        Returns
        -------
        ndarray, (..., 6)
            Linear momentum, then angular momentum.

        References
        ----------
        Orin, Goswami and Lee 2013, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35.
        """
        return self._answer("momentum", "pinocchio", q, v)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The frames by name: one at the origin of each link, also of links that are fixed to others."""
        return frame_names(self.model)

    @query({"R": ((3, 3), "1"), "p": ((3,), "m")}, pinocchio_queries.frame_pose)
    def frame_pose(self, q: ArrayLike, frame: str, engine: Engine = "auto") -> tuple[Array, Array]:
        """Pose of a frame in the world: x_world = R x_frame + p.

        Parameters
        ----------
        q : array_like, (..., nq)
            Configuration.
        frame : str
            One of `frame_names`.
        engine : {"auto", "pinocchio", "compiled"}
            Who answers; see the class.

        Returns
        -------
        R : ndarray, (..., 3, 3)
            Rotation matrix.
        p : ndarray, (..., 3)
            The frame's origin, m.

        Raises
        ------
        QueryError
            Code "unknown-frame"; the remedy is the nearest right name.
        """
        pose = self._answer(f"frame_pose:{frame}", engine, q)
        return pose[..., :9].reshape(*pose.shape[:-1], 3, 3), pose[..., 9:]

    @query({"velocity": ((6,), "m/s, then rad/s")}, by_axes(pinocchio_queries.frame_velocity))
    def frame_velocity(self, q: ArrayLike, v: ArrayLike, frame: str, axes: Axes = "aligned") -> Array:
        """Velocity of a frame: of its origin [m/s], then its angular velocity [rad/s], (..., 6).

        axes: "aligned" with the world's axes, or "local", along the frame's own. See `frame_pose`.
        """
        return self._answer(f"frame_velocity_{one_of(AXES, axes, 'axes')}:{frame}", "pinocchio", q, v)

    @query({"J": ((6, "nv"), "of a velocity by v")}, by_axes(pinocchio_queries.frame_jacobian))
    def frame_jacobian(self, q: ArrayLike, frame: str, axes: Axes = "aligned", engine: Engine = "auto") -> Array:
        """The Jacobian J(q) of a frame, (..., 6, nv): J v is the frame's velocity, linear then angular.

        Parameters
        ----------
        q : array_like, (..., nq)
            Configuration.
        frame : str
            One of `frame_names`.
        axes : {"aligned", "local"}
            "aligned" with the world's axes (Pinocchio's LOCAL_WORLD_ALIGNED), or "local", along the frame's own
            (LOCAL). The velocity is that of the frame's origin in both.
        engine : {"auto", "pinocchio", "compiled"}
            Who answers; see the class.

        Returns
        -------
        ndarray, (..., 6, nv)
            Three rows for the linear velocity, three for the angular velocity.
        """
        return self._answer(f"frame_jacobian_{one_of(AXES, axes, 'axes')}:{frame}", engine, q)

    def inverse_kinematics(
        self,
        frame: str,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        q0: ArrayLike | None = None,
    ) -> Array:
        """Configurations that bring a frame to positions, rotations, or both, within the limits of the joints.

        R(q) = rotation and p(q) = position, see `frame_pose`, to 1e-10 m and rad; what cannot be brought there so
        nearly is refused. It is the solution that Levenberg and Marquardt's method finds from q0, else from random
        starts, always the same ones.

        Parameters
        ----------
        frame : str
            One of `frame_names`.
        position : array_like, (..., 3), optional
            Of the frame's origin in the world, m. Any, if left out.
        rotation : array_like, (..., 3, 3), optional
            Rotation matrices. Any, if left out.
        q0 : array_like, (nq,), optional
            Where the search begins; the neutral configuration if left out. In a batch each target begins from the
            solution before it, so that a path of targets gives a path of the robot.

        Returns
        -------
        ndarray, (..., nq)
            Configurations.

        Raises
        ------
        QueryError
            Code "unreachable": its data has the distance [m] and the angle [rad] that are left, and the `closest`
            configuration that was found. A solution that the search does not find may exist. Code "unknown-frame".

        References
        ----------
        Sugihara 2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method".
        """
        return configurations.configurations_of(self, frame, position, rotation, q0)

    @query(_derivatives("a", "q", "v", "tau"), pinocchio_queries.forward_derivatives, mimic=_UNCOUPLED, anywhere=True)
    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, engine: Engine = "auto"
    ) -> tuple[Array, Array, Array]:
        """Derivatives (da/dq, da/dv, da/dtau) of the forward dynamics, (..., nv, nv) each.

        Column k of da/dq is the derivative along the k-th direction of the tangent space, as v is:
        q + dq means `integrate(q, dq)`. da/dtau = M^-1.

        Parameters
        ----------
        q, v, tau : array_like, (..., nq), (..., nv), (..., nv)
            Configuration, velocity and joint torque.
        engine : {"auto", "pinocchio", "compiled"}
            Who answers; see the class.

        Returns
        -------
        da_dq, da_dv, da_dtau : ndarray, (..., nv, nv)
            Entry [i, k] is the derivative of a_i along direction k.

        Raises
        ------
        QueryError
            With mimic joints (code "mimic-joints").

        References
        ----------
        Carpentier and Mansard 2018, "Analytical derivatives of rigid body dynamics algorithms".
        """
        matrices = self._answer("forward_dynamics_derivatives", engine, q, v, tau)
        return matrices[..., 0, :, :], matrices[..., 1, :, :], matrices[..., 2, :, :]

    @query(_derivatives("tau", "q", "v", "a"), pinocchio_queries.inverse_derivatives, mimic=_UNCOUPLED, anywhere=True)
    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, engine: Engine = "auto"
    ) -> tuple[Array, Array, Array]:
        """Derivatives (dtau/dq, dtau/dv, dtau/da = M) of the inverse dynamics, (..., nv, nv) each.

        Directions, errors and source as in `forward_dynamics_derivatives`.
        """
        matrices = self._answer("inverse_dynamics_derivatives", engine, q, v, a)
        return matrices[..., 0, :, :], matrices[..., 1, :, :], matrices[..., 2, :, :]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The names (p,) of the parameters pi in tau = Y pi, the columns of `regressor`.

        Of each link that moves, about the frame of the joint that carries it: LINK.mass [kg], LINK.first_moment.x|y|z
        (m c) [kg m] and LINK.origin_inertia.xx|xy|yy|xz|yz|zz [kg m^2], in Pinocchio's order; links fixed to it are
        part of it. Then of each joint with one degree of freedom JOINT.armature, JOINT.damping (viscous friction) and
        JOINT.friction (Coulomb friction). mass, armature and damping are those of `compiled(parameters=...)`.
        """
        return regressor_names(self.model)

    @property
    def parameter_values(self) -> Array:
        """pi (p,) of this robot, SI units. Damping and friction are 0, as in `inverse_dynamics` without losses."""
        return regressor_values(self.model)

    def regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """The regressor Y(q, v, a), (..., nv, p): the joint torques are tau = Y pi.

        Parameters
        ----------
        q, v, a : array_like, (..., nq), (..., nv), (..., nv)
            Configuration, velocity and acceleration.

        Returns
        -------
        ndarray, (..., nv, p)
            One column for each of `parameter_names`. Columns of Coulomb friction hold sign(v), 0 at rest.

        References
        ----------
        Atkeson, An and Hollerbach 1986, "Estimation of inertial parameters of manipulator loads and links".
        """
        return pinocchio_queries.answer(self, regressor_query(self), (q, v, a))

    def difference(self, q0: ArrayLike, q1: ArrayLike) -> Array:
        """The tangent vector from q0 to q1, (..., nv): integrate(q0, difference(q0, q1)) = q1.

        It is accurate for configurations that are close together, too. Angles of continuous, planar, spherical and
        free joints are the shortest, at most pi; those of revolute joints are plain differences.
        """
        return configurations.difference(self, q0, q1)

    def integrate(self, q: ArrayLike, dv: ArrayLike) -> Array:
        """The configuration (..., nq) reached from q by the constant velocity dv (..., nv) in unit time.

        It is the exponential map of each joint; quaternions and (cos, sin) pairs keep length 1.
        """
        return configurations.integrate(self, q, dv)

    def by_joint(self, letter: str, values: Mapping[str, ArrayLike]) -> Array:
        """A configuration (nq,) "q", or another vector (nv,) "v", "a" or "tau", from values by joint name.

        A joint's value is a number, its entries, or a text with a unit, such as "90 deg" or "30 deg/s"; one value of a
        continuous joint is its angle. Joints that are not named are neutral, or 0.

        Raises
        ------
        QueryError
            There is no such joint, or the value is not the joint's.
        """
        return by_joint(self, one_of(tuple(ARGUMENTS), letter, "letter"), values)

    def random_state(self, n: int, seed: int = 0) -> tuple[Array, Array]:
        """Random states (q (n, nq), v (n, nv)), the same for the same seed.

        Joint positions are uniform within their limits (within an interval of 2 pi, [-pi, pi] if it is allowed, where
        the limits are wider), orientations are uniform, and velocities are uniform within [-1, 1] rad/s or m/s.
        """
        return configurations.random_state(self, n, seed)

    def compiled(self, parameters: Sequence[str] = ()) -> Compiled:
        """The robot's queries as compiled functions; see `Compiled`.

        Parameters
        ----------
        parameters : sequence of str, optional
            Physical constants to keep as run-time inputs, such as ["forearm.mass", "gravity.z"].

        Raises
        ------
        QueryError
            For an unknown parameter.
        """
        self.require_inertia()
        return self._programs(tuple(parameters))

    def _programs(self, parameters: tuple[str, ...] = ()) -> Compiled:
        """As `compiled`, for frames of robots without inertia too."""
        made = self._compiled.get(parameters)
        return made if made is not None else self._compiled.setdefault(parameters, Compiled(self, parameters))

    def _answer(self, name: str, engine: str, *arguments: Any) -> Array:
        """A query by name: one state straight from Pinocchio, other arguments checked, by the engine of the rule."""
        query, q = self._queries.get(name) or self._query(name), arguments[0]
        if type(q) is np.ndarray and q.ndim == 2 and engine == "auto" and (made := self._compiled.get(())):
            found = made.of_rows(name, arguments) if len(q) >= compiled_from(name, self.nv) else None
            if found is not None:
                return found
        quick = (self._shown.get(name) or shows_all(self, self._shown, name)) and self._is_state(*arguments)
        if engine in _BY_PINOCCHIO and isfinite(total := 0.0 if quick else self._sum_of_state(*arguments)):
            result = query.one(self.model, self.data, *arguments)
            # "K" is the order of the memory, which needs no copy
            if isfinite(total + ((x := result.ravel("K")).dot(x) if result.ndim > 1 else sum(result.tolist()))):
                return result
        if self._is_compiled(name, engine, *arguments):
            return self._programs().answer(name, dict(zip(query.arguments, arguments, strict=True)))
        return pinocchio_queries.answer(self, query, arguments)

    def _query(self, name: str) -> Algorithm:
        if not name.startswith("frame_"):
            self.require_inertia()
        return self._queries.setdefault(name, pinocchio_queries.query_of(self, name))

    def _is_compiled(self, name: str, engine: str, *arguments: Any) -> bool:
        """True if the compiled function answers: always with engine="compiled", by the engine rule with "auto"."""
        if engine == "auto":
            count = max(map(states_of, arguments))
            if count < compiled_from(name, self.nv) or library() is None:
                return False
            try:
                self._programs().certificate(name)
            except CertificationError as error:
                warnings.warn(f"{error}", RuntimeWarning, stacklevel=4)
                return False
            return True
        return one_of(ENGINES, engine, "engine") == "compiled" and self.nv > 0  # else there is nothing to compile

    def _is_state(self, q: Any, *others: Any) -> bool:
        """True for float64 arrays of one state that Pinocchio can take as they are, units of length 1."""
        if type(q) is not np.ndarray or q.shape != self._q_shape or q.dtype is not _FLOAT:
            return False
        for y in others:
            if type(y) is not np.ndarray or y.shape != self._v_shape or y.dtype is not _FLOAT:
                return False
        return not self._unit_entries or isfinite(self._sum_of_state(q))

    def _sum_of_state(self, q: Any, *others: Any) -> float:
        """The sum of all entries of one state as float64 arrays, which Pinocchio can take as they are; else NaN.

        Sums of plain floats are not finite if any entry is not, and have none of NumPy's overhead. Where they overflow
        although no entry does, the caller takes the path that looks at each entry.
        """
        if type(q) is not np.ndarray or q.shape != self._q_shape or q.dtype is not _FLOAT:
            return nan
        x = q.tolist()
        for i, j, k, m in self._unit_entries:
            rest = x[k] * x[k] + x[m] * x[m] if m > j else 0.0
            if not abs(x[i] * x[i] + x[j] * x[j] + rest - 1) <= UNIT_TOLERANCE:
                return nan
        total: float = sum(x)
        for y in others:
            if type(y) is not np.ndarray or y.shape != self._v_shape or y.dtype is not _FLOAT:
                return nan
            total += sum(y.tolist())
        return total
