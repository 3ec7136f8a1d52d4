"""Shapes of bodies that touch: sphere, box, cylinder, capsule and convex mesh, placed in a link's axes.

The fields are those of URDF: a cylinder's and a capsule's axis is z; a capsule's length is that of its cylinder.
"""

from typing import Annotated, Any

import msgspec
import numpy as np
import pinocchio as pin

from twolink.errors import RobotError
from twolink.io.text import kebab_case

# A size in m. The bound is for JSON Schema and for checks of fields.
Length = Annotated[float, msgspec.Meta(extra_json_schema={"minimum": 0.0})]
Vector = tuple[float, float, float]


class Shape(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag=kebab_case):
    """A shape in a link's axes; `point` and `rpy` (fixed axes x y z) place it, as URDF's <origin> does."""

    @property
    def placement(self) -> pin.SE3:
        """Where it is in its link."""
        point, rpy = (np.array(getattr(self, name, (0.0, 0.0, 0.0)), float) for name in ("point", "rpy"))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), point)

    def coal(self) -> Any:
        """Coal's geometry."""
        raise NotImplementedError


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

    def coal(self) -> Any:
        """Coal's sphere."""
        import coal

        return coal.Sphere(float(self.radius))


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

    def coal(self) -> Any:
        """Coal's box."""
        import coal

        return coal.Box(*map(float, self.size))


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

    def coal(self) -> Any:
        """Coal's cylinder."""
        import coal

        return coal.Cylinder(float(self.radius), float(self.length))


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

    def coal(self) -> Any:
        """Coal's capsule."""
        import coal

        return coal.Capsule(float(self.radius), float(self.length))


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
        import coal

        cloud = coal.StdVec_Vec3s()
        for vertex in self.vertices:
            cloud.append(np.array(vertex, dtype=float))
        try:
            return coal.Convex.convexHull(cloud, False, None)
        except (RuntimeError, ValueError):
            raise no_volume(self) from None


def no_volume(shape: Convex) -> RobotError:
    """The failure of a hull that is flat."""
    return RobotError(f"its {len(shape.vertices)} vertices span no volume", where="Convex", code="flat-shape",
                      remedy="give it some thickness")  # fmt: skip


AnyShape = Sphere | Box | Cylinder | Capsule | Convex
