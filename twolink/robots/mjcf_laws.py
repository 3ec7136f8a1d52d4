"""Contents of an MJCF beside bodies and joints: springs, loops and gravity compensation as effects of a scene; and
what twolink has not, by whether it changes the motion.
"""

import itertools
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.robots.mjcf_model import SHAPES, Mjcf, pose
from twolink.robots.model import COMPENSATION

_FREE, _BALL = 0, 1  # mjtJoint
_CONNECT, _WELD, _JOINT = 0, 1, 2  # mjtEq
_EQUALITIES = ("connect", "weld", "joint", "tendon", "flex", "flexvert", "flexstrain", "distance")
_SITE = 6  # mjtObj
Masks = Mapping[int, frozenset[tuple[int, int]]]  # contype and conaffinity of shapes, by body
_PLANE, _FIELD = 0, 1  # mjtGeom
_OPTIONS = ("timestep", "integrator", "cone", "solver", "impratio", "iterations", "ls_iterations", "tolerance",
            "ls_tolerance", "noslip_iterations", "noslip_tolerance", "disableflags", "enableflags")  # fmt: skip


def without_counterpart(mjcf: Mjcf) -> dict[str, list[str]]:
    """Parts that change the motion and have no counterpart: names of elements by what they are; the others left out."""
    m, joints = mjcf.model, [f"joint {name!r}" for name in mjcf.joints]
    tendons, count = mjcf.names("tendon", "tendon"), len(m.actuator_trntype)
    many = [m.jnt_type[k] in (_FREE, _BALL) for k in range(m.njnt)]
    springs, damped = not mjcf.is_off("SPRING"), not mjcf.is_off("DAMPER")
    rubbed = not mjcf.is_off("FRICTIONLOSS", "CONSTRAINT")
    first = [int(k) for k in m.jnt_dofadr]
    away = [m.actuator_trntype[k] not in (0, 1) or many[m.actuator_trnid[k, 0]] for k in range(count)]

    def where(names: list[str], values: np.ndarray, among: Any = True) -> list[str]:
        return [name for name, on in zip(names, np.any(values, axis=-1) & np.array(among, bool), strict=True) if on]

    def tendon(what: str) -> list[str]:
        return where(tendons, mjcf.numbers(f"tendon_{what}", m.ntendon))

    def actuator(what: str, among: Any = True) -> list[str]:
        return where(mjcf.names("actuator", "actuator"), mjcf.numbers(f"actuator_{what}", count), among)

    equalities = [] if mjcf.is_off("EQUALITY", "CONSTRAINT") else [
        f"{name} ({_EQUALITIES[m.eq_type[k]]})" for k, name in enumerate(mjcf.names("eq", "equality"))
        if m.eq_active0[k] and not _has_loop(m, k)]  # fmt: skip
    found = {
        "a fluid": [f"option {name}" for name in ("density", "viscosity") if getattr(m.opt, name)],
        "a flexible body": mjcf.names("flex", "flex"),
        "a plugin of a body": where(mjcf.names("body", "body"), mjcf.numbers("body_plugin", m.nbody) >= 0,
                                    m.nplugin > 0),
        "the spring of a tendon": springs * (tendon("stiffness") + tendon("stiffnesspoly")),
        "the damping of a tendon": damped * (tendon("damping") + tendon("dampingpoly")),
        "the friction of a tendon": rubbed * tendon("frictionloss"),
        "the armature of a tendon": tendon("armature"),
        "the spring of a ball or free joint": springs * where(joints, mjcf.numbers("jnt_stiffness", m.njnt), many),
        "the friction of a ball or free joint": rubbed * where(joints, m.dof_frictionloss[first].reshape(-1, 1), many),
        "the armature of a free joint": where(joints, m.dof_armature[first].reshape(-1, 1), m.jnt_type == _FREE),
        "a spring that is not linear": springs * where(joints, mjcf.numbers("jnt_stiffnesspoly", m.njnt)),
        "damping that is not linear": damped * (
            where(joints, mjcf.numbers("dof_dampingpoly", m.nv)[first]) + actuator("dampingpoly")),
        "the armature of an actuator that acts on no joint of one axis": actuator("armature", away),
        "the damping of an actuator that acts on no joint of one axis": damped * actuator("damping", away),
        "an equality constraint of this kind": equalities,
    }  # fmt: skip
    return {what: names for what, names in found.items() if names}


def left_out(mjcf: Mjcf) -> dict[str, list[str]]:
    """Parts without effect on the answers: names of elements by what they are."""
    m = mjcf.model
    unknown = {k for k in range(m.ngeom) if int(m.geom_type[k]) not in SHAPES} - set(grounds(mjcf))
    off = [name for name, flag in (("springs", "SPRING"), ("damping", "DAMPER"), ("joint friction", "FRICTIONLOSS"),
           ("limits", "LIMIT"), ("equality constraints", "EQUALITY"), ("gravity", "GRAVITY"),
           ("constraints", "CONSTRAINT")) if mjcf.is_off(flag)]  # fmt: skip
    geoms, tendons = mjcf.names("geom"), mjcf.names("tendon")
    idle = [name for k, name in enumerate(mjcf.names("eq")) if not m.eq_active0[k]]
    moved = [name for k, name in enumerate(mjcf.bodies) if m.body_mocapid[k] >= 0]
    found = {
        "what the file's flags disable": off,
        "actuators (no command is given, none acts)": mjcf.names("actuator"),
        "tendons (they exert no force by themselves; their limits are left out)": tendons,
        "equality constraints that are not active": idle,
        "shapes that a URDF has not": [geoms[k] for k in sorted(unknown)],
        "contact pairs (their friction and softness are their own)": mjcf.names("pair"),
        "masks of contact of single shapes, or of the ground (these bodies touch with all shapes)": _unlike(mjcf),
        "limits of ball joints (they turn freely)": [
            name for k, name in enumerate(mjcf.joints) if m.jnt_type[k] == _BALL and m.jnt_limited[k]
        ],
        "margins (bodies touch, and joints stop, without the distance that MuJoCo keeps)": [
            *(geoms[k] for k in np.flatnonzero(m.geom_margin * (m.geom_contype | m.geom_conaffinity))),
            *(mjcf.joints[k] for k in np.flatnonzero(m.jnt_margin * m.jnt_limited)),
        ],
        "bodies that a program moves (mocap): they stay": moved,
        "sensors": mjcf.names("sensor"),
        "plugins": mjcf.names("plugin") if m.nplugin else [],
        "skins": mjcf.names("skin"),
        "keyframes": mjcf.names("key"),
        "sites": mjcf.names("site"),
        "cameras and lights": mjcf.names("cam") + mjcf.names("light"),
        "data of other programs": mjcf.names("numeric") + mjcf.names("text"),
    }
    solver = [f"time step {m.opt.timestep:g} s", "integrator, solver, and the softness of contacts and constraints"]
    return {what: names for what, names in {**found, "options of MuJoCo's simulation": solver}.items() if names}


def options_of(mjcf: Mjcf) -> dict[str, float]:
    """The options by which MuJoCo would step the file, by their names in its mjOption."""
    return {name: float(getattr(mjcf.model.opt, name)) for name in _OPTIONS}


def grounds(mjcf: Mjcf) -> dict[int, tuple[str, Mapping[str, Any]]]:
    """Planes, and height fields that lie level, which the world has: by their geoms, with types as in scene files."""
    m, found = mjcf.model, dict[int, tuple[str, Mapping[str, Any]]]()
    collides = (m.geom_contype | m.geom_conaffinity) != 0
    for k in map(int, np.flatnonzero((m.geom_type <= _FIELD) & (m.body_weldid[m.geom_bodyid] == 0) & collides)):
        place = mjcf.placed(k)
        normal = place.rotation[:, 2]
        if m.geom_type[k] == _PLANE:
            found[k] = "plane", {"normal": _three(normal), "height": float(normal @ place.translation)}
        elif np.allclose(place.rotation, np.eye(3), atol=1e-9):
            found[k] = "height-field", _height_field(m, int(m.geom_dataid[k]), place.translation)
    return found


def _height_field(m: Any, one: int, middle: np.ndarray) -> Mapping[str, Any]:
    """A height field, as in scene files. middle: of its ground."""
    rows, columns, (x, y, high, _) = int(m.hfield_nrow[one]), int(m.hfield_ncol[one]), m.hfield_size[one].tolist()
    first = int(m.hfield_adr[one])
    heights = high * m.hfield_data[first : first + rows * columns].astype(float).reshape(rows, columns).T
    return {"heights": heights.tolist(), "cell": (2 * x / (columns - 1), 2 * y / (rows - 1)),
            "point": _three(middle - [x, y, 0.0])}  # fmt: skip


def excluded(mjcf: Mjcf) -> frozenset[frozenset[str]]:
    """Pairs of bodies that do not touch, by <exclude> or by the masks of all their shapes.

    A signature of <exclude> holds the number of one body in its upper 16 bits. Shapes of a <pair> touch by any mask.
    """
    m = mjcf.model
    signatures, owners = map(int, m.exclude_signature), m.geom_bodyid
    paired = {frozenset(map(int, owners[[m.pair_geom1[k], m.pair_geom2[k]]])) for k in range(m.npair)}
    apart = [frozenset(pair) for pair, some, _ in _masked(mjcf, _colliding(mjcf, SHAPES)) if not some]
    found = [(s >> 16, s & 0xFFFF) for s in signatures] + [tuple(pair) for pair in apart if pair not in paired]
    return frozenset(frozenset((mjcf.bodies[a], mjcf.bodies[b])) for a, b in found)


def _colliding(mjcf: Mjcf, kinds: Collection[int]) -> Masks:
    """The masks (contype, conaffinity) of the shapes of some kinds that collide, by body."""
    m, found = mjcf.model, dict[int, set[tuple[int, int]]]()
    for k in map(int, np.flatnonzero(m.geom_contype | m.geom_conaffinity)):
        if int(m.geom_type[k]) in kinds:
            found.setdefault(int(m.geom_bodyid[k]), set()).add((int(m.geom_contype[k]), int(m.geom_conaffinity[k])))
    return {body: frozenset(masks) for body, masks in found.items()}


def _masked(mjcf: Mjcf, masks: Masks, others: Masks | None = None) -> Iterator[tuple[tuple[int, int], bool, bool]]:
    """Pairs of bodies that move against each other; whether some pairs of their shapes touch, and whether all do."""
    known, welded = dict[Any, tuple[bool, bool]](), mjcf.model.body_weldid
    for a, b in itertools.combinations(masks, 2) if others is None else itertools.product(masks, others):
        if welded[a] != welded[b]:
            key = masks[a], (masks if others is None else others)[b]
            if key not in known:
                touching = [bool(c & f or d & e) for (c, d), (e, f) in itertools.product(*key)]
                known[key] = any(touching), all(touching)
            yield (a, b), *known[key]


def _unlike(mjcf: Mjcf) -> list[str]:
    """Bodies with masks that cannot be kept: some of their shapes touch one body, or not a plane or a field of heights.

    Bodies touch others, and the ground, with all their shapes.
    """
    shapes, ground = _colliding(mjcf, SHAPES), _colliding(mjcf, (_PLANE, _FIELD))
    mixed = {body for pair, some, every in _masked(mjcf, shapes) if some and not every for body in pair}
    mixed |= {pair[0] for pair, _, every in _masked(mjcf, shapes, ground) if not every}
    return [mjcf.bodies[body] for body in sorted(mixed)]


def effects_of(mjcf: Mjcf) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Springs, gravity compensation and loops, by type and arguments as in scene files."""
    m = mjcf.model
    sprung = [k for k in range(m.njnt) if m.jnt_stiffness[k] and m.jnt_type[k] not in (_FREE, _BALL)]
    if sprung and not mjcf.is_off("SPRING"):
        stiffness = {mjcf.joints[k]: float(m.jnt_stiffness[k]) for k in sprung}
        rest = {mjcf.joints[k]: float(m.qpos_spring[m.jnt_qposadr[k]]) for k in sprung}
        yield "joint-spring", {"stiffness": stiffness, "rest": rest}
    for k in map(int, np.flatnonzero(m.body_gravcomp * (m.body_weldid > 0))):
        if not mjcf.is_off("GRAVITY"):
            yield COMPENSATION, {"frame": mjcf.bodies[k], "mass": float(m.body_mass[k] * m.body_gravcomp[k]),
                                 "point": _three(m.body_ipos[k])}  # fmt: skip
    for equality in range(m.neq):
        if m.eq_active0[equality] and _has_loop(m, equality) and not mjcf.is_off("EQUALITY", "CONSTRAINT"):
            yield _loop(mjcf, equality)


def _has_loop(m: Any, equality: int) -> bool:
    """True if an equality constraint has a counterpart."""
    kind, data = m.eq_type[equality], m.eq_data[equality]
    return kind in (_CONNECT, _WELD) or (kind == _JOINT and m.eq_obj2id[equality] >= 0 and not data[2:5].any())


def _loop(mjcf: Mjcf, equality: int) -> tuple[str, Mapping[str, Any]]:
    """An equality constraint of points, bodies or joints."""
    m, data = mjcf.model, mjcf.model.eq_data[equality]
    ends = int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])
    if m.eq_type[equality] == _JOINT:  # q - q0 = c + r (q' - q0')
        q, other = (float(m.qpos0[m.jnt_qposadr[k]]) for k in ends)
        ratio = float(data[1])
        return "coupling", {"joint": mjcf.joints[ends[0]], "other": mjcf.joints[ends[1]], "ratio": ratio,
                            "offset": q + float(data[0]) - ratio * other}  # fmt: skip
    if m.eq_objtype[equality] == _SITE:
        bodies = [int(m.site_bodyid[k]) for k in ends]
        first, second = (pose(m.site_pos[k], m.site_quat[k]) for k in ends)
    else:
        bodies, still = list(ends), np.array([1.0, 0.0, 0.0, 0.0])
        if m.eq_type[equality] == _CONNECT:
            first, second = pose(data[:3], still), pose(data[3:6], still)
        else:
            first, second = pose(data[3:6], data[6:10]), pose(data[:3], still)
    names = {"a": mjcf.bodies[bodies[0]], "b": mjcf.bodies[bodies[1]],
             "point_a": _three(first.translation), "point_b": _three(second.translation)}  # fmt: skip
    if m.eq_type[equality] == _CONNECT:
        return "point-loop", names
    turned = second.rotation @ first.rotation.T  # of a as b sees it
    return "weld-loop", {**names, "rpy": _three(pin.rpy.matrixToRpy(turned))}


def _three(values: Any) -> tuple[float, ...]:
    return tuple(float(x) for x in values)
