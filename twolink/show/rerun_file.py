"""A motion as a recording of Rerun: its robot's surfaces on links that move, and curves."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import import_extra
from twolink.io.files import write_atomic
from twolink.show.meshcat_shapes import Floats
from twolink.show.surfaces import surfaces
from twolink.show.viewer_data import place_on_link

EXTRA = "rerun"  # of twolink, which installs rerun-sdk


def write_rrd(
    path: Path, title: str, robot: tuple[Any, Any], links: Mapping[int, str], t: Floats, poses: Floats,
    curves: Mapping[tuple[str, ...], Floats],
) -> list[str]:  # fmt: skip
    """Write a .rrd file, and return the names of the pieces that cannot be drawn.

    Parameters
    ----------
    path : Path
    title : str
    robot : (pin.Model, pin.GeometryModel)
        The model and its visuals.
    links : mapping of int to str
        Names of the links by the indices of their frames.
    t : ndarray (n,)
        s.
    poses : ndarray (n, links, 7)
        Position [m] and quaternion (x y z w) of each link in the world.
    curves : mapping of tuple of str to ndarray (n,)
        Curves by the path of their entity, such as ("q", "elbow").
    """
    rr, views = import_extra("rerun", EXTRA), import_extra("rerun.blueprint", EXTRA)
    model, visuals = robot
    record = rr.RecordingStream("twolink")
    record.send_recording_name(title)
    times = [rr.TimeColumn("time", duration=t)]

    def entity(*parts: str) -> str:
        return str(rr.new_entity_path(parts))

    record.log("robot", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for link, pose in zip(links.values(), np.moveaxis(poses, 1, 0), strict=True):
        columns = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, 3:])
        rr.send_columns(entity("robot", link), times, columns, recording=record)
    drawn, skipped = surfaces(visuals)
    for surface in drawn:
        item = visuals.geometryObjects[surface.index]
        carrier, place = place_on_link(model, links, item)
        name = entity("robot", *([] if carrier is None else [carrier]), item.name)
        corners, normals, colours = (x.reshape(-1, 3) for x in (surface.triangles, surface.normals, surface.colours))
        pose = pin.SE3ToXYZQUAT(place)
        record.log(name, rr.Transform3D(translation=pose[:3], quaternion=pose[3:]), static=True)
        record.log(name, rr.Mesh3D(vertex_positions=corners, vertex_normals=normals,
                                   vertex_colors=np.rint(255 * colours).astype(np.uint8)), static=True)  # fmt: skip
    for parts, values in curves.items():
        rr.send_columns(entity(*parts), times, rr.Scalars.columns(scalars=values), recording=record)
    plots = [views.TimeSeriesView(origin=f"/{name}", name=name) for name in dict.fromkeys(parts[0] for parts in curves)]
    layout = views.Blueprint(views.Horizontal(views.Spatial3DView(origin="/robot"), views.Vertical(*plots)))
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "run.rrd"
        record.save(made, default_blueprint=layout)
        record.disconnect()
        write_atomic(path, lambda file: file.write(made.read_bytes()))
    return skipped
