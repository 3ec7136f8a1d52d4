"""Compiled: a robot's queries as programs, each certified against Pinocchio before its first use."""

import contextlib
import logging
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.functions import FrameForce, frame_pose, function
from twolink.algorithms.mechanism import nominal
from twolink.algorithms.recursions import Axes
from twolink.dynamics import pinocchio_queries
from twolink.dynamics.arguments import FExt, array, batch_shape, configuration, one_of, read_wrenches, rows
from twolink.dynamics.certificates import KernelCertificate, certify
from twolink.dynamics.kernels import Kernel, build
from twolink.dynamics.queries import Array
from twolink.errors import CertificationError, QueryError, nearest
from twolink.io import cache
from twolink.io.fingerprints import kernel_key
from twolink.robots.model import RobotModel

Parameters = Mapping[str, ArrayLike] | None
AXES = ("aligned", "local")
_FLOAT = np.dtype(float)
_log = logging.getLogger("twolink")


class Compiled:
    """The queries of a Robot as programs: the same names, arguments and results, for one state or a batch.

    A function is traced when it is first needed (or read from the disk cache) and certified. May be used from many
    threads at once.

    Parameters
    ----------
    robot : RobotModel
        The robot.
    parameters : sequence of str, optional
        Physical constants that stay run-time inputs (`algorithms.mechanism.parameter_names`). Every query then takes
        parameters={name: value}, a number or one value for each state of the batch; the others are nominal.

    Raises
    ------
    QueryError
        For an unknown parameter.

    Notes
    -----
    Arrays whose memory holds one state a column (transposed views of C-ordered (nv, n) arrays) are read without
    a copy, and the result is such a view.
    """

    def __init__(self, robot: RobotModel, parameters: Sequence[str] = ()) -> None:
        for name in parameters:
            nominal(robot.model, name)  # refuses an unknown name
        self.robot = robot
        self.parameters: tuple[str, ...] = tuple(dict.fromkeys(parameters))
        self._made: dict[tuple[str, ...], tuple[Kernel, KernelCertificate] | CertificationError] = {}
        self._lock = threading.Lock()

    def __repr__(self) -> str:
        ready = ", ".join(certificate.function for certificate in self.certificates) or "none yet"
        kept = f", parameters {', '.join(self.parameters)}" if self.parameters else ""
        return f"<Compiled {self.robot.name!r}: functions {ready}{kept}>"

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, f_ext: FExt | None = None, parameters: Parameters = None
    ) -> Array:
        """a = M^-1 (tau - h + J^T f_ext), (..., nv); see `Robot.forward_dynamics`."""
        return self.answer("forward_dynamics", {"q": q, "v": v, "tau": tau}, parameters, f_ext)

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: FExt | None = None, losses: bool = False,
        parameters: Parameters = None,
    ) -> Array:  # fmt: skip
        """tau = M a + h - J^T f_ext, (..., nv); see `Robot.inverse_dynamics`.

        Damping that is kept as a parameter is always in it, and losses do not add it again.
        """
        tau = self.answer("inverse_dynamics", {"q": q, "v": v, "a": a}, parameters, f_ext)
        damped = [name.removesuffix(".damping") for name in self.parameters if name.endswith(".damping")]
        return tau if losses is False else pinocchio_queries.with_losses(self.robot, losses, tau, v, damped)

    def mass_matrix(self, q: ArrayLike, parameters: Parameters = None) -> Array:
        """M(q), (..., nv, nv)."""
        return self.answer("mass_matrix", {"q": q}, parameters)

    def bias(self, q: ArrayLike, v: ArrayLike, parameters: Parameters = None) -> Array:
        """h(q, v), (..., nv)."""
        return self.answer("bias", {"q": q, "v": v}, parameters)

    def gravity_torque(self, q: ArrayLike, parameters: Parameters = None) -> Array:
        """g(q), (..., nv)."""
        return self.answer("gravity_torque", {"q": q}, parameters)

    def energy(self, q: ArrayLike, v: ArrayLike, parameters: Parameters = None) -> tuple[Array, Array]:
        """(kinetic, potential), (...,) each, J."""
        both = self.answer("energy", {"q": q, "v": v}, parameters)
        return both[..., 0], both[..., 1]

    def frame_pose(self, q: ArrayLike, frame: str, parameters: Parameters = None) -> tuple[Array, Array]:
        """(R, p), (..., 3, 3) and (..., 3), m: x_world = R x_frame + p."""
        pose = self.answer(f"frame_pose:{frame}", {"q": q}, parameters)
        return pose[..., :9].reshape(*pose.shape[:-1], 3, 3), pose[..., 9:]

    def frame_jacobian(self, q: ArrayLike, frame: str, axes: Axes = "aligned", parameters: Parameters = None) -> Array:
        """J (..., 6, nv) with J v = (velocity of the frame's origin, angular velocity); see `Robot.frame_jacobian`."""
        return self.answer(f"frame_jacobian_{one_of(AXES, axes, 'axes')}:{frame}", {"q": q}, parameters)

    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, parameters: Parameters = None
    ) -> tuple[Array, Array, Array]:
        """(da/dq, da/dv, da/dtau), (..., nv, nv) each; dq in the tangent space, as pin.computeABADerivatives."""
        all_three = self.answer("forward_dynamics_derivatives", {"q": q, "v": v, "tau": tau}, parameters)
        return all_three[..., 0, :, :], all_three[..., 1, :, :], all_three[..., 2, :, :]

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, parameters: Parameters = None
    ) -> tuple[Array, Array, Array]:
        """(dtau/dq, dtau/dv, dtau/da), (..., nv, nv) each; dq in the tangent space, as pin.computeRNEADerivatives."""
        all_three = self.answer("inverse_dynamics_derivatives", {"q": q, "v": v, "a": a}, parameters)
        return all_three[..., 0, :, :], all_three[..., 1, :, :], all_three[..., 2, :, :]

    def certificate(self, name: str) -> KernelCertificate:
        """The certificate of a function, such as "forward_dynamics" or "frame_pose:tip"; made if there is none."""
        return self._kernel(name, ())[1]

    @property
    def certificates(self) -> tuple[KernelCertificate, ...]:
        """The certificates of all functions built so far."""
        return tuple(made[1] for made in self._made.values() if not isinstance(made, CertificationError))

    def _kernel(self, name: str, frames: tuple[str, ...]) -> tuple[Kernel, KernelCertificate]:
        """The certified kernel of a function with wrenches on frames. Raises CertificationError."""
        key = (name, *frames)
        if key not in self._made:
            with self._lock:
                if key not in self._made:
                    self._made[key] = self._load_or_build(name, frames)
        made = self._made[key]
        if isinstance(made, CertificationError):
            raise made
        return made

    def _load_or_build(
        self, name: str, frames: tuple[str, ...]
    ) -> tuple[Kernel, KernelCertificate] | CertificationError:
        """A kernel from the cache, checked again on a few states, or a new one, or why a new one is refused."""
        model, start = self.robot.model, time.perf_counter()
        forces = [FrameForce(f"f_ext:{frame}", *frame_pose(model, frame)) for frame in frames]
        traced, file = function(model, name, forces), kernel_key(model, (name, *frames, "|", *self.parameters))
        match cache.load(file):
            case (Kernel() as kernel, certificate):
                with contextlib.suppress(CertificationError):  # made elsewhere, or damaged: build it again
                    certify(self.robot, traced, kernel, self.parameters, 4)  # one of each kind of state
                    return kernel, certificate
        try:
            kernel = build(model, traced, self.parameters)
            certificate = certify(self.robot, traced, kernel, self.parameters)
        except CertificationError as error:
            return error
        _log.info("traced %s of %s in %.2f s", name, self.robot.name, time.perf_counter() - start)
        cache.store(file, (kernel, certificate))
        return kernel, certificate

    def answer(
        self, name: str, arguments: Mapping[str, ArrayLike], parameters: Parameters = None, f_ext: FExt | None = None
    ) -> Array:
        """Any function by its name, such as "bias" or "frame_pose:tip", of its arguments by name."""
        wrenches = self._own_axes(f_ext, arguments["q"]) if f_ext else {}
        kernel, _ = self._kernel(name, tuple(wrenches))
        forces: dict[str, ArrayLike] = {f"f_ext:{frame}": value for frame, value in wrenches.items()}
        sizes = dict(zip((*arguments, *forces, *self.parameters), kernel.sizes, strict=True))
        arrays = {k: shaped(k, value, sizes[k]) for k, value in {**arguments, **forces}.items()}
        arrays |= self._parameter_arrays(parameters)
        batch = batch_shape(**arrays)
        result = kernel([states(a, batch) for a in arrays.values()])
        if result is None:
            return self._by_pinocchio(name, {**arguments, **forces}, arrays)
        return result if result.shape[: -len(kernel.shape)] == batch else result.reshape(*batch, *kernel.shape)

    def of_rows(self, name: str, arguments: Sequence[Any]) -> Array | None:
        """The answer of a function that is there already for arrays (n, size) that need no conversion; else None."""
        made = self._made.get((name,))
        return made[0](arguments) if isinstance(made, tuple) and _are_rows(arguments, made[0].sizes) else None

    def _own_axes(self, f_ext: FExt, q: ArrayLike) -> dict[str, Array]:
        """Wrenches by frame, turned into the frames' own axes."""
        out: dict[str, Array] = {}
        for wrench in read_wrenches(self.robot.model, f_ext):
            value = wrench.value
            if wrench.axes == "world":
                turn = np.swapaxes(self.frame_pose(q, wrench.frame)[0], -1, -2)
                parts = [(turn @ value[..., i : i + 3, None])[..., 0] for i in (0, 3)]
                value = np.concatenate(parts, axis=-1)
            out[wrench.frame] = value
        return out

    def _parameter_arrays(self, parameters: Parameters) -> dict[str, Array]:
        values = {} if parameters is None else parameters
        if not isinstance(values, Mapping):
            what = f"expected a mapping of name to value, got {type(values).__name__}"
            name = self.parameters[0] if self.parameters else "name"
            raise QueryError(what, argument="parameters", remedy=f"parameters={{{name!r}: value}}")
        for name in values:
            if name not in self.parameters:
                remedy = f"robot.compiled(parameters=[{name!r}])"
                remedy = nearest(name, self.parameters) if self.parameters else remedy
                raise QueryError(f"{name!r} is not kept as a parameter", argument="parameters", remedy=remedy)
        arrays = {}
        for name in self.parameters:
            given = values[name] if name in values else nominal(self.robot.model, name)
            arrays[name] = array(f"parameters[{name!r}]", given, None)[..., None]
        return arrays

    def _by_pinocchio(self, name: str, arguments: Mapping[str, ArrayLike], arrays: dict[str, Array]) -> Array:
        """The answer where the guard failed: an argument is refused, or a result is not finite."""
        robot = self.robot
        for key, value in arrays.items():
            size = value.shape[-1]
            configuration(key, value, size, robot.joints) if key == "q" else array(key, value, size)
        if self.parameters:
            raise QueryError("the result is not finite", where=f"compiled {name}", remedy="check the values",
                             code="not-finite")  # fmt: skip
        return pinocchio_queries.by_name(robot, name, arguments)


def _are_rows(arrays: Sequence[Any], sizes: tuple[int, ...]) -> TypeGuard[Sequence[Array]]:
    """True if arrays are (n, size) of float64 each, with one n above 0."""
    count = len(arrays[0])
    for a, size in zip(arrays, sizes, strict=True):
        if type(a) is not np.ndarray or a.shape != (count, size) or a.dtype is not _FLOAT:
            return False
    return count > 0


def shaped(name: str, value: ArrayLike, size: int) -> Array:
    """`value` as float64 of shape (..., size); the kernel's guard checks its entries."""
    if type(value) is np.ndarray and value.dtype == np.float64 and value.ndim and value.shape[-1] == size:
        return value
    return array(name, value, size)


def states(a: Array, batch: tuple[int, ...]) -> Array:
    """(n, size) of the batch: a view where one axis leads, else rows."""
    return np.broadcast_to(a, (*batch, a.shape[-1])) if len(batch) == 1 else rows(a, batch)
