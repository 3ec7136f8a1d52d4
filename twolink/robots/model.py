"""RobotModel: a robot whose URDF was read, checked and reported; and the pickling of models with mimic joints, of
which Pinocchio 4.1 forgets a part.

After pickling, such a joint states nvExtended = -1, and the next query writes outside its arrays: the process dies. The
joints are therefore built again, from their own type and axis.
"""

import copyreg
import functools
import re
import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np
import pinocchio as pin

from twolink.errors import QueryError, RobotError, ShowError
from twolink.io.fingerprints import ModelTree, trees_of
from twolink.io.mesh_files import Part
from twolink.robots.collisions import Solid, read_solids
from twolink.robots.joint_layout import JointLayout, gravity_field, joint_layouts, shapes_without_joints
from twolink.robots.load_report import LoadReport
from twolink.robots.meshes import MeshFile, VisualModel, set_mesh, without_meshes
from twolink.robots.srdf import Srdf

COMPENSATION = "gravity-compensation"
_Mimic = tuple[int, int, str, tuple[float, ...], float, float]


def mimics(model: pin.Model) -> list[_Mimic]:
    """Of each mimic joint: its index, the index of the joint it follows, its type, axis, multiplier and offset."""
    if not len(model.mimicking_joints):
        return []
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    found = []
    for index in model.mimicking_joints:
        joint = model.joints[index].extract()
        text = str(joint)
        kind = re.search(r"Mimicking joint type: (\w+)", text)
        followed = re.search(r"Mimicked joint id: (\d+)", text)
        if kind is None or followed is None:
            raise TypeError(f"Pinocchio describes a mimic joint as {text!r}")
        subspace = np.asarray(data.joints[index].S).ravel() / joint.scaling
        axis = tuple(float(x) for x in (subspace[:3] if np.any(subspace[:3]) else subspace[3:]))
        found.append((int(index), int(followed[1]), kind[1], axis, float(joint.scaling), float(joint.offset)))
    return found


def reduce_model(model: pin.Model) -> tuple[Any, ...]:
    """Pickle a model, for `copyreg.pickle`: the function that restores it, with its arguments."""
    plain = model.__reduce__()
    found = mimics(model)
    return (restore_model, (*plain[1:3], found)) if found else plain


def _joint(kind: str, axis: tuple[float, ...]) -> Any:
    """A joint model of a type; of its axis, where the type does not say it."""
    if kind != "JointModelRevoluteUnboundedUnaligned":
        return getattr(pin, kind)(*([np.array(axis)] if kind.endswith("Unaligned") else []))
    along = " ".join(map(repr, axis))  # Pinocchio 4.1 makes this type from a URDF only
    text = f"""<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">
        <parent link="a"/><child link="b"/><axis xyz="{along}"/></joint></robot>"""
    return pin.buildModelFromXML(text).joints[1].extract()


def mimic_joint(model: pin.Model, followed: int, kind: str, axis: tuple[float, ...], scaling: float, offset: float,
                ) -> Any:  # fmt: skip
    """A joint that follows joint number `followed` of a model."""
    leader, joint = model.joints[followed], _joint(kind, axis)
    joint.setIndexes(followed, leader.idx_q, leader.idx_v, leader.idx_vExtended)
    return pin.JointModelMimic(joint, scaling, offset)


def restore_model(arguments: tuple[Any, ...], state: Any, followers: list[_Mimic]) -> pin.Model:
    """The model that `reduce_model` has taken apart."""
    model = pin.Model(*arguments)
    model.__setstate__(state)
    for one in followers:
        mimic, index, leader = mimic_joint(model, *one[1:]), one[0], model.joints[one[1]]
        mimic.setIndexes(index, leader.idx_q, leader.idx_v, model.idx_vExtendeds[index])
        model.joints[index] = pin.JointModel(mimic)
    return model


ROOT = "root_joint"  # of a robot with a free base, as Pinocchio calls it
LARGEST = 200  # degrees of freedom of several trees: that of the whole takes 0.3 GB

copyreg.pickle(pin.Model, reduce_model)


@dataclass(frozen=True)
class FileLaws:
    """Parts of a scene in a robot's file that a URDF cannot hold: effects, by type and arguments as in scene files; the
    mass at a point of a frame whose weight is compensated, under any gravity; and the configuration at the start, by
    joint. options: by which MuJoCo would step it, as its mjOption has them. grounds: planes and height fields that are
    fixed to the world, by type and arguments too."""

    effects: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    start: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    options: Mapping[str, float] = field(default_factory=dict)
    grounds: tuple[tuple[str, Mapping[str, Any]], ...] = ()


@dataclass(frozen=True)
class Visuals:
    """Data for drawing and contact: URDF text with visuals and collisions, the meshes of both by Pinocchio's names,
    the model before joints were locked, and where they were locked. laws: what acts on it by its file. placed:
    the poses at which free objects beside it start, by joint."""

    text: str
    meshes: dict[str, MeshFile]
    model: pin.Model
    locked: tuple[int, ...]
    reference: np.ndarray
    collision_meshes: dict[str, MeshFile] = field(default_factory=dict)
    laws: FileLaws = field(default_factory=FileLaws)
    placed: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    srdf: Srdf = field(default_factory=Srdf)

    @property
    def lock(self) -> dict[str, list[float]]:
        """The locked joints with their configurations, as load_robot takes them."""
        starts = {self.model.names[j]: (self.model.idx_qs[j], self.model.nqs[j]) for j in self.locked}
        return {name: self.reference[start : start + size].tolist() for name, (start, size) in starts.items()}


class RobotModel:
    """A robot that passed every check: a pin.Model that is shared and never changed, names, and the load report.

    Attributes
    ----------
    name : str
        The robot's name.
    model : pin.Model
        The model; do not change it, every query and thread reads it.
    report : LoadReport
        What is suspicious, and what was read, ignored, repaired and assumed.
    nq, nv : int
        The sizes of a configuration and of a velocity.
    joint_names : tuple of str
        The moving joints, in Pinocchio's order.
    joints : tuple of JointLayout
        The layout of q and v, joint by joint.
    visuals : Visuals
        What is needed to draw the robot.
    has_mimic : bool
        Whether some joints follow others (loaded with mimic=True).
    weightless : tuple of str
        Joints that move no inertia (loaded with purpose="kinematics" or "identification"): dynamics is refused.
    changed_by : tuple of str
        The effects of a scene, as texts, that have changed its constants: of `scene.robot`, not of `scene.base`.
    """

    def __init__(self, name: str, model: pin.Model, report: LoadReport, visuals: Visuals) -> None:
        self.name = name
        self.model = model
        self.report = report
        self.nq: int = model.nq
        self.nv: int = model.nv
        self.joints: tuple[JointLayout, ...] = joint_layouts(model)
        self.joint_names: tuple[str, ...] = tuple(j.name for j in self.joints)
        self.has_mimic: bool = any(j.kind == "mimic" for j in self.joints)
        self.visuals = visuals
        self.weightless: tuple[str, ...] = ()
        self.changed_by: tuple[str, ...] = ()
        # For single queries, where one attribute more costs a twentieth of Pinocchio's own time.
        self._v_shape = (self.nv,)
        self._q_shape = (self.nq,) if self.is_whole else None
        units = [j.normalized for j in self.joints if j.normalized is not None]
        self._unit_entries = tuple((u.start, u.start + 1, u.stop - 2, u.stop - 1) for u in units)
        self._local = threading.local()

    @property
    def root(self) -> Literal["fixed", "free"]:
        """The base it was loaded with."""
        model = self.visuals.model
        free = model.njoints > 1 and model.names[1] == ROOT and f'joint name="{ROOT}"' not in self.visuals.text
        return "free" if free else "fixed"

    @property
    def neutral(self) -> np.ndarray:
        """The neutral configuration (nq,): zeros, unit quaternions, (cos, sin) = (1, 0)."""
        return np.asarray(pin.neutral(self.model))

    @property
    def mass(self) -> float:
        """The mass that moves, kg (what is fixed to the world is not in it)."""
        return float(sum(self.model.inertias[j].mass for j in range(1, self.model.njoints)))

    @property
    def gravity(self) -> np.ndarray:
        """The gravity field (3,), m/s^2, in the world's axes."""
        return np.array(self.model.gravity.linear)

    @property
    def data(self) -> pin.Data:
        """This thread's pin.Data: made on first use in a thread, never shared."""
        try:
            return self._local.data
        except AttributeError:
            if not self.is_whole:
                raise QueryError(
                    f"a pin.Data of {self.nv} degrees of freedom takes about {3.2e-8 * self.nv**3:.0f} GB",
                    where=f"robot {self.name!r}", code="too-large",
                    remedy="load its parts, which only the ground connects, as robots of their own",
                ) from None  # fmt: skip
            self._local.data = self.model.createData()
            return self._local.data

    @functools.cached_property
    def _base_positions(self) -> list[int]:
        """The entries of q that move a whole tree along the world's axes."""
        first = {"free-flyer": 3, "planar": 2}
        bases = [] if self.has_mimic else [joint for joint in self.joints if self.model.parents[joint.index] == 0]
        moving = [(joint.q.start, 1 if joint.unit == "m" else first.get(joint.kind, 0)) for joint in bases]
        return [entry for start, count in moving for entry in range(start, start + count)]

    def with_bases_at_origin(self, q: np.ndarray) -> np.ndarray:
        """The configurations (..., nq) with every base at the origin, for what does not depend on where bases are.

        Pinocchio's derivatives, computeCoriolisMatrix, computeMinverse and abaInParallel work in the world's axes, and
        lose digits with the distance from its origin, most with its square: up to 1e-3 of the answer at 100 km.
        """
        if not self._base_positions:
            return q
        out = q.copy()
        out[..., self._base_positions] = 0.0
        return out

    @functools.cached_property
    def trees(self) -> tuple[ModelTree, ...]:
        """Its parts that only the ground connects, each as a model of its own."""
        return trees_of(self.model)

    @functools.cached_property
    def is_whole(self) -> bool:
        """True if the robot has a pin.Data; else only its trees have, for that of the whole would be too large."""
        return self.nv <= LARGEST or len(self.trees) == 1

    @property
    def tree_data(self) -> tuple[pin.Data, ...]:
        """This thread's pin.Data of each tree."""
        try:
            made: tuple[pin.Data, ...] = self._local.tree_data
        except AttributeError:
            made = self._local.tree_data = tuple(tree.model.createData() for tree in self.trees)
        return made

    def normalize(self, q: np.ndarray) -> np.ndarray:
        """Scale the quaternions and (cos, sin) pairs of configurations to length 1.

        Parameters
        ----------
        q : array_like
            Configurations (..., nq).

        Returns
        -------
        ndarray
            A new array (..., nq).

        Raises
        ------
        QueryError
            The shape is another one, or a quaternion or pair is zero.
        """
        try:
            out = np.array(q, dtype=float)
        except (TypeError, ValueError):
            out = np.empty(0)
        if out.ndim == 0 or out.shape[-1] != self.nq:
            raise QueryError(f"expected shape (..., {self.nq})", argument="q", remedy="give configurations")
        for joint in self.joints:
            if joint.normalized is not None:
                length = np.linalg.norm(out[..., joint.normalized], axis=-1, keepdims=True)
                if not np.all(length > 0):
                    entries = f"{joint.normalized.start}:{joint.normalized.stop}"
                    what = f"entries {entries} of joint {joint.name!r} have no direction"
                    raise QueryError(what, argument="q", remedy="give a quaternion or a (cos, sin) pair")
                out[..., joint.normalized] /= length
        return out

    def with_gravity(self, gravity: np.ndarray) -> Self:
        """Copy the robot into another gravity field (3,) [m/s^2]. Raises QueryError unless it has 3 finite numbers."""
        field = gravity_field(gravity, QueryError)

        def change(model: pin.Model) -> None:
            model.gravity.linear = field

        return self.changed(change)

    def changed(self, change: Callable[[pin.Model], None]) -> Self:
        """A copy of the robot with other constants: `change` sets them in a copy of the model."""
        model = self.model.copy()
        change(model)
        robot = type(self)(self.name, model, self.report, self.visuals)
        robot.weightless, robot.changed_by = self.weightless, self.changed_by
        return robot

    def require_inertia(self) -> None:
        """Refuse dynamics of a robot with weightless joints. Raises QueryError (code "no-inertia")."""
        if self.weightless:
            raise QueryError(
                f"joints {', '.join(self.weightless)} move no inertia, so that dynamics is not determined",
                where=f"robot {self.name!r}", code="no-inertia",
                remedy="identify it first (`tl.identify(...).found`), or give the links a mass and an inertia",
            )  # fmt: skip

    def visual_model(self, *, tree: bool = True) -> VisualModel:
        """The shapes to draw, without meshes that have no file. Raises ShowError for a mesh that cannot be read.

        tree: meshes have what collisions need. False is faster, and for drawing only.
        """
        visuals = self.visuals
        geometry, read = pin.GeometryModel(), dict[str, tuple[Part, ...]]()
        try:
            text = without_meshes(visuals.text)
            pin.buildGeomFromUrdfString(visuals.model, text, pin.GeometryType.VISUAL, geometry, [])
        except (ValueError, RuntimeError) as error:
            what, remedy = " ".join(str(error).split())[:200], "repair that visual, or take it out of the URDF"
            raise ShowError(what, where=f"robot {self.name!r}", remedy=remedy, code="visuals-not-readable") from None
        for item in geometry.geometryObjects:
            if item.name in visuals.meshes:
                set_mesh(item, visuals.meshes[item.name], tree, read)
        shapes = shapes_without_joints(visuals.model, geometry, visuals.locked, visuals.reference)
        return VisualModel(shapes, read)

    @functools.cached_property
    def _solids(self) -> dict[str, tuple[Solid, ...] | RobotError]:
        return read_solids(self.visuals.text, self.visuals.collision_meshes, f"robot {self.name!r}")

    @property
    def has_solids(self) -> bool:
        """True if a link has a collision shape, whether or not it can be read."""
        return any(self._solids.values())

    @property
    def solids(self) -> tuple[Solid, ...]:
        """The collision shapes of the links. Raises RobotError for one that has no size, or a mesh without a file."""
        return self.solids_besides(())

    def solids_besides(self, links: Collection[str]) -> tuple[Solid, ...]:
        """The collision shapes of all other links. Raises RobotError as `solids`."""
        solids = list[Solid]()
        for link, found in self._solids.items():
            if link not in links:
                if isinstance(found, RobotError):
                    raise found.with_traceback(None)
                solids += found
        return tuple(solids)

    def __deepcopy__(self, memo: dict[int, Any]) -> "RobotModel":
        return self  # nothing writes to a model

    def __reduce__(self) -> tuple[Any, ...]:
        state = {"weightless": self.weightless, "changed_by": self.changed_by}
        return type(self), (self.name, self.model, self.report, self.visuals), state
