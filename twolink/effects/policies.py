"""Policies: networks from ONNX files that observe a robot at ticks, and whose actions hold between them."""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import msgspec
import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import plus
from twolink.dynamics import Robot
from twolink.effects.checks import check_effect, check_joints, check_subset, single_joints
from twolink.effects.controllers import JointPD, Limits
from twolink.effects.effect import Effect, Loads, NotNegative, all_finite, finite, number
from twolink.effects.inputs import Slot
from twolink.effects.sampled_control import STATE, Controller, Seconds
from twolink.errors import SceneError
from twolink.io.networks import Network, file_digest, read_network
from twolink.robots.joint_layout import JointLayout

Array = np.ndarray[Any, np.dtype[Any]]
Numbers = Any  # a float, or a tuple of floats
OF_JOINTS = "joint_pos", "joint_vel"
OF_BASE = {"base_lin_vel": slice(0, 3), "base_ang_vel": slice(3, 6)}  # of v of a base that floats
OTHERS = "projected_gravity", "last_action", "command"


class Observed(msgspec.Struct, frozen=True):
    """A part of an observation: scale (value - offset), within a clip, of the last ticks.

    Parameters
    ----------
    name : str
        "joint_pos" (rad, m; of a continuous joint the angle from -pi to pi), "joint_vel" (per second), "base_lin_vel",
        "base_ang_vel" (of a base that floats, along its own axes), "projected_gravity" (the direction of the scene's
        gravity, without it that of -z, along these axes), "last_action" (as the network gave it), "command"
        (constants), or a sensor of the scene.
    joints : tuple of str
        Of joint_pos and joint_vel, in the policy's order; by default the outputs.
    offset, scale : float or tuple of float
        One for all numbers, or one each.
    clip : (float, float) or None
    history : int
        Of how many ticks, the oldest first; before the first tick there are its own values.
    values : tuple of float
        Of "command".
    """

    name: str
    joints: tuple[str, ...] = ()
    offset: Numbers = 0.0
    scale: Numbers = 1.0
    clip: tuple[float, float] | None = None
    history: int = 1
    values: tuple[float, ...] = ()


def base_of(robot: Robot, joint: str) -> JointLayout | None:
    """The joint of the free base that carries a joint; None where there is none. An object beside it has another."""
    i = robot.model.getJointId(joint)
    while robot.model.parents[i]:
        i = robot.model.parents[i]
    return next((one for one in robot.joints if one.name == robot.model.names[i] and one.kind == "free-flyer"), None)


class PolicyLaw:
    """The law of a policy, of rows: it observes, asks the network, and maps its answer."""

    plain: ClassVar[bool] = True

    def __init__(self, policy: "Policy", joints: Sequence[str], robot: Robot) -> None:
        self._given = policy, joints, robot
        self.network, self.policy, self._joints = policy.network, policy, joints
        self._places = {one.name: (one.q, one.v) for one in robot.joints}
        self._base = base_of(robot, joints[0])
        size = np.linalg.norm(robot.gravity)
        self._down = robot.gravity / size if size else np.array([0.0, 0.0, -1.0])
        self._scale, self._offset = np.asarray(policy.scale), 0.0 if policy.kp else np.asarray(policy.offset)

    def __deepcopy__(self, _: Any) -> "PolicyLaw":
        """Itself: nothing of it changes."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given

    def __call__(self, _: float, y: Any, state: Any) -> Any:
        """The numbers that hold (n, m), and (the last action, the histories, what the network keeps)."""
        n = len(next(iter(vars(y).values())))
        last, histories, kept = state or (np.zeros((n, len(self._joints))), None, self.network.start(n))
        now = [self._part(one, y, last) for one in self.policy.observed]
        shown = histories or [np.repeat(x[:, None], one.history, axis=1)
                              for one, x in zip(self.policy.observed, now, strict=True)]  # fmt: skip
        shown = [np.concatenate([old[:, 1:], x[:, None]], axis=1) for old, x in zip(shown, now, strict=True)]
        action, kept = self.network(np.concatenate([x.reshape(n, -1) for x in shown], axis=1), kept)
        used = action if self.policy.clip is None else np.clip(action, *self.policy.clip)
        return self._offset + self._scale * used, (action, shown, kept)

    def _part(self, one: Observed, y: Any, last: Array) -> Array:
        """The numbers (n, k) of a part at this tick."""
        x = (np.asarray(self._seen(one, y, last), dtype=float) - one.offset) * one.scale
        return np.asarray(x if one.clip is None else np.clip(x, *one.clip))

    def _seen(self, one: Observed, y: Any, last: Array) -> Any:
        if one.name in OF_JOINTS:
            kind = OF_JOINTS.index(one.name)
            values = y[STATE[kind]]
            rows = [values[:, self._places[joint][kind]].T for joint in one.joints or self._joints]
            return np.stack([x[0] if len(x) == 1 else np.arctan2(x[1], x[0]) for x in rows], axis=1)
        if self._base is not None and one.name in OF_BASE:
            return y.v[:, self._base.v][:, OF_BASE[one.name]]
        if self._base is not None and one.name == "projected_gravity":
            u, w = np.split(y.q[:, self._base.q][:, 3:], [3], axis=1)
            turned = 2.0 * np.cross(self._down, u)  # by the inverse of the base's quaternion
            return self._down + w * turned + np.cross(turned, u)
        if one.name == "command":
            return np.tile(one.values, (len(last), 1))
        return last if one.name == "last_action" else y[one.name].reshape(len(last), -1)


class HeldPositions(JointPD, frozen=True, kw_only=True):
    """PD control to positions that are constant from tick to tick: tau = kp (position - q) - kd v, within limits.

    target: of the positions less their offset: 0 until the first answer acts.
    """

    analytic: ClassVar[bool] = False

    target: Mapping[str, Slot]  # type: ignore[assignment]
    offset: Mapping[str, float] = {}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add the torques."""
        positions = {joint: plus(value, number(self.offset[joint])) for joint, value in self.target.items()}
        JointPD.act(msgspec.structs.replace(self, target=positions), motion, loads)


class Policy(Effect, frozen=True, dict=True):
    """A network from an ONNX file that is asked at ticks, and whose answer holds between them.

        a_k = network(observation at k period),   u_k = offset + scale a_k

    Without kp, tau = u_k; with it, tau = kp (u_k - q) - kd v at all times: u_k are positions. Until the first answer
    acts, after a start or a delay, the torques are 0; with kp the actions are 0, so that the positions are the offset.

    Parameters
    ----------
    file : str
        The path of the ONNX file: float32 networks of Gemm, MatMul, activations, LSTM, GRU, ... with the extra `onnx`.
    period, start, delay, jitter : float or Fraction
        s, as those of `Controller`, whose offset is the start.
    seed : int
        Of the jitter.
    content : str
        The SHA-256 of the file and of weights beside it: another content is refused. Empty: any; sweeps note what they
        began with.
    inputs : tuple of str or Observed
        The observation, part by part.
    outputs : tuple of str
        The joints that are driven, in the policy's order; empty: all of one degree of freedom.
    scale, offset : float or tuple of float
        Of the actions: one for all, or one each; N m or N, or of positions rad or m.
    clip : (float, float) or None
        Of the actions, before they are scaled.
    kp, kd : mapping of joint to float
        N m/rad or N/m, of all driven joints, which are not continuous; and N m s/rad or N s/m, 0 by default.
    limit : mapping of joint to float, "urdf" or None
        Of the torques, N m or N.

    Notes
    -----
    The network is computed in double precision for all solutions of an error bar at once: in float32 its answers are
    steps of 1e-7, thresholds that no error bar can cross. Where onnxruntime is installed it is held against it. The
    error bar is that of the motion under the network, not of how well the network does.

    References
    ----------
    ONNX operators, version 1.16; maps as in the descriptors of Isaac Lab 2 and mjlab.
    """

    file: str
    period: Seconds
    inputs: tuple[str | Observed, ...] = OF_JOINTS
    outputs: tuple[str, ...] = ()
    scale: Numbers = 1.0
    offset: Numbers = 0.0
    clip: tuple[float, float] | None = None
    kp: Mapping[str, NotNegative] = {}
    kd: Mapping[str, NotNegative] = {}
    limit: Limits = None
    start: Seconds = 0.0
    delay: Seconds = 0.0
    jitter: Seconds = 0.0
    seed: int = 0
    content: str = ""

    @functools.cached_property
    def network(self) -> Network:
        """The network of the file. Raises as `read_network`."""
        return read_network(self.file, self.content)

    def pinned(self) -> "Policy":
        """The policy with the content that its file has now."""
        return msgspec.structs.replace(self, content=file_digest(self.file))

    @property
    def observed(self) -> list[Observed]:
        """The parts of the observation."""
        return [one if isinstance(one, Observed) else Observed(one) for one in self.inputs]

    @functools.cached_property
    def sampled(self) -> Controller:
        """The controller that asks the network."""
        sensors = sorted({one.name for one in self.observed} - {*OF_JOINTS, *OF_BASE, *OTHERS})
        return _Asking(self.network, self.period, self.start, self.delay, self.jitter, self.seed, None,
                       (*STATE, *sensors), self.outputs, limit=None if self.kp else self.limit, traced=False,
                       vectorized=True, policy=self)  # fmt: skip

    def held(self, robot: Robot, place: int) -> Effect:
        """The effect between ticks: held torques, or a PD control to held positions."""
        torques = self.sampled.held(robot, place)
        offset = dict(zip(torques.values, np.broadcast_to(self.offset, len(torques.values)).tolist(), strict=True))
        if not self.kp:
            return torques
        return HeldPositions(target=torques.values, kp=self.kp, kd=self.kd, effort=self.limit, offset=offset)

    def check(self, robot: Robot) -> None:
        """Require a network that fits the observation and the joints."""
        self.sampled.check(robot)
        joints = self.sampled.joints(robot)
        if self.kp or self.kd:
            check_subset(self.kp, joints, "kp", "driven joint")
            check_joints(joints, robot, "kp", coordinates=True)  # the angle of a continuous joint would jump at pi
            check_effect(JointPD(dict.fromkeys(joints, 0.0), self.kp, self.kd, effort=self.limit), robot)
        _check_clip(self.clip, "clip")
        for name in ("scale", "offset"):
            _check_size(getattr(self, name), len(joints), name)
        sizes = [_size(one, robot, joints, f"inputs[{i}]") for i, one in enumerate(self.observed)]
        observed = None if None in sizes else sum(x or 0 for x in sizes)  # of sensors it is not known yet
        network = self.network
        for what, found, wanted in (("inputs", observed, network.inputs), ("outputs", len(joints), network.outputs)):
            if found not in (None, wanted):
                raise SceneError(f"the network has {wanted} {what}, here are {found}", where=what,
                                 remedy="the parts and joints of its training, in their order")  # fmt: skip


class _Asking(Controller, frozen=True):
    """The controller of a policy."""

    policy: Any = None

    def on(self, robot: Robot) -> Controller:
        """The controller on a robot."""
        return msgspec.structs.replace(self, update=PolicyLaw(self.policy, self.joints(robot), robot))


def _size(one: Observed, robot: Robot, joints: Sequence[str], where: str) -> int | None:
    """The number of numbers that a part has; None of a sensor. Raises SceneError."""
    size: int | None = None
    if one.name in OF_JOINTS:
        check_joints(one.joints or single_joints(robot), robot, f"{where}.joints", dofs=True)
        size = len(one.joints or joints)
    elif one.name in OF_BASE or one.name == "projected_gravity":
        size = 3
        if base_of(robot, joints[0]) is None:
            raise SceneError(f"{one.name!r} of a robot whose base is fixed", where=where,
                             remedy='load_robot(..., root="free")')  # fmt: skip
    elif one.name in OTHERS:
        size = len(joints if one.name == "last_action" else one.values)
    if one.history < 1:
        raise SceneError(f"expected a whole number above 0, got {one.history}", where=f"{where}.history")
    _check_clip(one.clip, f"{where}.clip")
    for name in ("offset", "scale"):
        _check_size(getattr(one, name), size, f"{where}.{name}")
    return size and one.history * size


def _check_clip(clip: Any, where: str) -> None:
    """Require None, or two numbers that increase. Raises SceneError."""
    if clip is not None and not (isinstance(clip, tuple | list) and len(clip) == 2 and clip[0] < clip[1]):
        raise SceneError(f"expected (low, high) with low < high, got {clip!r:.60}", where=where,
                         remedy="such as (-1.0, 1.0)")  # fmt: skip


def _check_size(values: Numbers, size: int | None, where: str) -> None:
    """Require a number, or one each. Raises SceneError."""
    if isinstance(values, tuple):
        all_finite(values, where)
        if size not in (None, len(values)):
            raise SceneError(f"expected {size} numbers, got {len(values)}", where=where, remedy="one, or one each")
    else:
        finite(values, where)
