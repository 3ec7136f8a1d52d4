"""Shapes of bodies that touch, and the shapes of a robot's links: the <collision> elements of its URDF.

The fields are those of URDF: a cylinder's and a capsule's axis is z; a capsule's length is that of its cylinder.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import coal
import msgspec
import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, ShowError, nearest
from twolink.io import cache
from twolink.io.mesh_files import Floats, read_triangles
from twolink.io.text import kebab_case
from twolink.robots.xml import Element, Reader, parse_xml

if TYPE_CHECKING:
    from twolink.robots.meshes import MeshFile

# A size in m. The bound is for JSON Schema and for checks of fields.
Length = Annotated[float, msgspec.Meta(extra_json_schema={"minimum": 0.0})]
Vector = tuple[float, float, float]
FLAT = 1e-3  # of a mesh's size: what lies less deep below its convex hull counts as on it
MOST_LOOKED_AT = 500_000  # triangles times sides of the hull
VERSION = 1  # of hulls that are kept
_ATTRIBUTES = {"origin": {"xyz", "rpy"}, "sphere": {"radius"}, "box": {"size"}, "mesh": {"filename", "scale"},
               "cylinder": {"radius", "length"}, "capsule": {"radius", "length"}}  # fmt: skip


class Shape(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, tag_field="kind", tag=kebab_case
):
    """A shape in a link's axes; `point` and `rpy` (fixed axes x y z) place it, as URDF's <origin> does."""

    @property
    def placement(self) -> pin.SE3:
        """The pose of the shape in its link."""
        point, rpy = (np.array(getattr(self, name, (0.0, 0.0, 0.0)), float) for name in ("point", "rpy"))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), point)

    @property
    def sizes(self) -> dict[str, Any]:
        """The sizes, in the order that Coal takes them in."""
        return {key: getattr(self, key) for key in ("size", "radius", "length") if hasattr(self, key)}

    def coal(self) -> Any:
        """Coal's geometry, whose class has the same name."""
        numbers = (value if isinstance(value, Iterable) else (value,) for value in self.sizes.values())
        return getattr(coal, type(self).__name__)(*map(float, itertools.chain.from_iterable(numbers)))


class Sphere(Shape, frozen=True):
    """A sphere.

    Parameters
    ----------
    radius : float
        m; 0 for a point.
    point : (float, float, float)
        Its centre in the link's axes, m.
    """

    radius: Length
    point: Vector = (0.0, 0.0, 0.0)


class Box(Shape, frozen=True):
    """A box.

    Parameters
    ----------
    size : (float, float, float)
        Its edges along its own x, y, z, m.
    point, rpy : (float, float, float)
        Its centre in the link's axes, m; its turn, rad.
    """

    size: tuple[Length, Length, Length]
    point: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


class Cylinder(Shape, frozen=True):
    """A cylinder about its own z axis.

    Parameters
    ----------
    radius, length : float
        m.
    point, rpy : (float, float, float)
        Its centre in the link's axes, m; its turn, rad.
    """

    radius: Length
    length: Length
    point: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


class Capsule(Shape, frozen=True):
    """A cylinder about its own z axis with a half sphere at each end.

    Parameters
    ----------
    radius, length : float
        m; the length is that of the cylinder alone.
    point, rpy : (float, float, float)
        Its centre in the link's axes, m; its turn, rad.
    """

    radius: Length
    length: Length
    point: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


class Convex(Shape, frozen=True):
    """The convex hull of points.

    Parameters
    ----------
    vertices : tuple of (float, float, float)
        m, in the shape's own axes.
    point, rpy : (float, float, float)
        Its origin in the link's axes, m; its turn, rad.
    """

    vertices: tuple[Vector, ...]
    point: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def coal(self) -> Any:
        """Coal's convex hull."""
        try:
            return _coal_hull(self.vertices)
        except (RuntimeError, ValueError):
            raise no_volume(self) from None


@functools.lru_cache(maxsize=512)
def _coal_hull(vertices: tuple[Vector, ...]) -> Any:
    cloud = coal.StdVec_Vec3s()
    cloud.extend(np.array(vertices, dtype=float))
    return coal.Convex.convexHull(cloud, False, None)


def no_volume(shape: Convex) -> RobotError:
    """The failure of a hull that is flat."""
    return RobotError(f"its {len(shape.vertices)} vertices span no volume", where="Convex", code="flat-shape",
                      remedy="give it some thickness")  # fmt: skip


AnyShape = Sphere | Box | Cylinder | Capsule | Convex


@dataclass(frozen=True)
class Solid:
    """A shape of a link. name: its own in the URDF, else LINK_NUMBER as Pinocchio numbers them.

    hollow: of a mesh, how far parts of its surface lie below that of its convex hull, m. mesh: its file. Convex parts
    of one mesh share its name.
    """

    name: str
    link: str
    shape: AnyShape
    hollow: float = 0.0
    mesh: MeshFile | None = field(default=None, compare=False, repr=False)


def read_solids(text: str, meshes: Mapping[str, MeshFile], label: str) -> dict[str, tuple[Solid, ...] | RobotError]:
    """The collision shapes of each link of a URDF whose meshes are found, in its order.

    In their place a RobotError for a size that is missing or not above 0, for a mesh without a file, and for what is
    given twice or has an unknown name.
    """
    reader, solids = Reader(label, (1, 2), lines=False), dict[str, tuple[Solid, ...] | RobotError]()
    for link in parse_xml(text.encode(), label, "utf-8").all("link"):
        owner = link.attributes.get("name", "")
        try:
            solids[owner] = tuple(_solid(reader, collision, owner, f"{owner}_{number}", meshes)
                                  for number, collision in enumerate(link.all("collision")))  # fmt: skip
        except RobotError as error:
            solids[owner] = error
    return solids


def collision_model(model: pin.Model, solids: Sequence[Solid]) -> pin.GeometryModel:
    """Coal's geometry of solids, without pairs; object k is solid k."""
    geometry = pin.GeometryModel()
    for number, solid in enumerate(solids):
        frame = model.frames[model.getFrameId(solid.link, pin.FrameType.BODY)]
        place = frame.placement * solid.shape.placement
        item = pin.GeometryObject(f"{number} {solid.name}", frame.parentJoint, place, solid.shape.coal())
        geometry.addGeometryObject(item)
    return geometry


def _solid(reader: Reader, collision: Element, link: str, key: str, meshes: Mapping[str, MeshFile]) -> Solid:
    name = collision.attributes.get("name", "").strip() or key
    owner = f"link {link!r}, collision {name!r}"
    element = _only(reader, collision, owner)
    origin, point, rpy = collision.first("origin"), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if origin is not None:
        point = _three(reader, origin, "xyz", owner)
        rpy = _three(reader, origin, "rpy", owner)
    if element.tag == "mesh":
        file = meshes.get(key)
        return Solid(name, link, *_convex(reader, element, owner, file, point, rpy), file)
    return Solid(name, link, _shape(reader, element, owner, point, rpy))


def _only(reader: Reader, collision: Element, owner: str) -> Element:
    """The one shape of a collision. Raises RobotError for none, several, and unknown attributes."""
    shapes = [shape for geometry in collision.all("geometry") for shape in geometry.children]
    if not shapes:
        raise reader.error(collision, owner, "it has no shape", "add one, or remove the <collision>")
    origins = list(collision.all("origin"))
    for what, found in (("shapes", shapes), ("origins", origins)):
        if len(found) > 1:
            remedy = "give each shape a <collision> of its own"
            raise reader.error(collision, owner, f"it has {len(found)} {what}, expected one", remedy)
    for element in (*shapes, *origins):
        for key in element.attributes.keys() - _ATTRIBUTES.get(element.tag, element.attributes.keys()):
            what = f"<{element.tag}> has an unknown attribute {key!r}"
            raise reader.error(element, owner, what, nearest(key, sorted(_ATTRIBUTES[element.tag])))
    return shapes[0]


def _shape(reader: Reader, element: Element, owner: str, point: Vector, rpy: Vector) -> AnyShape:

    def size(key: str, count: int = 1) -> tuple[float, ...]:
        values = reader.numbers(element, key, owner, count)
        if not min(values) > 0:
            raise reader.error(element, owner, f"its {key} is {element.attributes[key]}", "give sizes above 0, in m")
        return values

    match element.tag:
        case "sphere":
            return Sphere(size("radius")[0], point)
        case "box":
            x, y, z = size("size", 3)
            return Box((x, y, z), point, rpy)
        case "cylinder":
            return Cylinder(size("radius")[0], size("length")[0], point, rpy)
        case "capsule":
            return Capsule(size("radius")[0], size("length")[0], point, rpy)
    raise reader.error(element, owner, f"<{element.tag}> is no shape", "sphere, box, cylinder, capsule or mesh")


def _three(reader: Reader, element: Element, key: str, owner: str) -> Vector:
    x, y, z = reader.numbers(element, key, owner, 3, (0.0, 0.0, 0.0))
    return x, y, z


def _convex(
    reader: Reader, element: Element, owner: str, mesh: MeshFile | None, point: Vector, rpy: Vector
) -> tuple[Convex, float]:
    """The convex hull of a mesh file, and how far parts of the mesh lie below its surface, m."""
    if mesh is None:
        what = f"its mesh {element.attributes.get('filename', '')!r} was not found"
        raise RobotError(what, where=reader.where(element, owner), code="mesh-not-readable",
                         remedy="give package_dirs=, or shapes= to Contact")  # fmt: skip
    scale = reader.numbers(element, "scale", owner, 3, (1.0, 1.0, 1.0))
    try:
        hull, hollow = _hull(*mesh.read(), scale)
    except (OSError, ValueError, ShowError) as error:
        what = f"the mesh {mesh.path.name!r} cannot be read: {str(error).splitlines()[0] if str(error) else error!r}"
        raise RobotError(what, where=reader.where(element, owner), code="mesh-not-readable",
                         remedy="repair it, or give shapes= to Contact") from None  # fmt: skip
    return Convex(tuple(map(tuple, hull.tolist())), point, rpy), hollow


def _hull(raw: bytes, suffix: str, scale: tuple[float, ...]) -> tuple[Floats, float]:
    """The corners (n, 3) of a mesh's convex hull, and how far its surface lies below, m. Kept by content.

    Raises ValueError for what is no mesh, and for one without volume.
    """
    name = "hull-" + hashlib.sha256(repr((VERSION, suffix, scale)).encode() + raw).hexdigest()
    known = cache.load(name)
    if known is not None:
        return known  # type: ignore[no-any-return]
    from scipy.spatial import ConvexHull, QhullError  # 0.1 s: only where it is used

    vertices, faces = read_triangles(raw, suffix)
    vertices = np.asarray(vertices) * scale
    try:
        found = ConvexHull(vertices)
    except QhullError:
        raise ValueError("all of its points lie in a plane") from None
    hull, sides = np.unique(vertices[found.vertices], axis=0), found.equations
    faces = np.asarray(faces)[:: 1 + len(faces) * len(sides) // MOST_LOOKED_AT]
    middles = vertices[faces].mean(axis=1)
    hollow = -float((middles @ sides[:, :3].T + sides[:, 3]).max(axis=1).min())
    found_hull = hull, hollow if hollow > FLAT * float(np.ptp(hull, axis=0).max()) else 0.0
    cache.store(name, found_hull)
    return found_hull
