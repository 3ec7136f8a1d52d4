"""The collision shapes of a robot's links, from the <collision> elements of its URDF; and Coal's view of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, ShowError
from twolink.io.confined import read_confined
from twolink.io.mesh_triangles import read_triangles
from twolink.robots.mesh_shapes import LARGEST
from twolink.robots.shapes import AnyShape, Box, Capsule, Convex, Cylinder, Sphere, Vector
from twolink.robots.xml import Element, Reader, parse_xml

if TYPE_CHECKING:
    from twolink.robots.meshes import MeshFile


@dataclass(frozen=True)
class Solid:
    """A shape of a link. name: its own in the URDF, else LINK_NUMBER as Pinocchio numbers them."""

    name: str
    link: str
    shape: AnyShape


def read_solids(text: str, meshes: Mapping[str, MeshFile], label: str) -> tuple[Solid, ...]:
    """The collision shapes in a URDF whose meshes are found, in its order.

    Raises RobotError for a size that is missing or not above 0, and for a mesh without a file.
    """
    reader = Reader(label, (1, 2))
    solids = []
    for link in parse_xml(text.encode(), label, "utf-8").all("link"):
        owner = link.attributes.get("name", "")
        for number, collision in enumerate(link.all("collision")):
            key = f"{owner}_{number}"
            name = collision.attributes.get("name", "").strip() or key
            shape = _shape(reader, collision, f"link {owner!r}, collision {name!r}", meshes.get(key))
            solids.append(Solid(name, owner, shape))
    return tuple(solids)


def collision_model(model: pin.Model, solids: Sequence[Solid]) -> pin.GeometryModel:
    """Coal's geometry of solids, without pairs; object k is solid k."""
    geometry = pin.GeometryModel()
    for number, solid in enumerate(solids):
        frame = model.frames[model.getFrameId(solid.link, pin.FrameType.BODY)]
        place = frame.placement * solid.shape.placement
        item = pin.GeometryObject(f"{number} {solid.name}", frame.parentJoint, place, solid.shape.coal())
        geometry.addGeometryObject(item)
    return geometry


def _shape(reader: Reader, collision: Element, owner: str, mesh: MeshFile | None) -> AnyShape:
    geometry, origin = collision.first("geometry"), collision.first("origin")
    if geometry is None or not geometry.children:
        raise reader.error(collision, owner, "it has no shape", "add one, or remove the <collision>")
    point = rpy = (0.0, 0.0, 0.0)
    if origin is not None:
        point = _three(reader, origin, "xyz", owner)
        rpy = _three(reader, origin, "rpy", owner)
    element = geometry.children[0]

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
        case "mesh":
            return _convex(reader, element, owner, mesh, point, rpy)
    raise reader.error(element, owner, f"<{element.tag}> is no shape", "sphere, box, cylinder, capsule or mesh")


def _three(reader: Reader, element: Element, key: str, owner: str) -> Vector:
    x, y, z = reader.numbers(element, key, owner, 3, (0.0, 0.0, 0.0))
    return x, y, z


def _convex(reader: Reader, element: Element, owner: str, mesh: MeshFile | None, point: Vector, rpy: Vector) -> Convex:
    """The convex hull of a mesh file."""
    if mesh is None:
        what = f"its mesh {element.attributes.get('filename', '')!r} was not found"
        raise RobotError(what, where=owner, remedy="give package_dirs=, or a simple shape", code="mesh-not-readable")
    from scipy.spatial import ConvexHull, QhullError  # 0.1 s: only where it is used

    scale = reader.numbers(element, "scale", owner, 3, (1.0, 1.0, 1.0))
    try:
        vertices, _ = read_triangles(read_confined(mesh.root, mesh.path, LARGEST), mesh.path.suffix.lower())
        cloud = np.unique(np.asarray(vertices) * scale, axis=0)
        hull = cloud[ConvexHull(cloud).vertices]
    except (OSError, ValueError, ShowError, QhullError) as error:
        what = f"the mesh {mesh.path.name!r} cannot be read: {str(error).splitlines()[0] if str(error) else error!r}"
        raise RobotError(what, where=owner, remedy="repair it, or give a simple shape",
                         code="mesh-not-readable") from None  # fmt: skip
    return Convex(tuple((float(x), float(y), float(z)) for x, y, z in hull), point, rpy)
