"""Geometry models and small mesh files for the tests."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

Robot = tuple[Any, Any]
URDF = Path(__file__).parents[2] / "urdf" / "two_link.urdf"


def geometry(name: str, shape: Any, *, joint: int = 0, mesh: str = "", override: bool = False) -> Any:
    colour = np.array([1.0, 0.0, 0.0, 0.5])
    return pin.GeometryObject(name, joint, pin.SE3.Identity(), shape, mesh, np.ones(3), override, colour)


def fixed(*items: Any) -> Robot:
    visuals = pin.GeometryModel()
    for item in items:
        visuals.addGeometryObject(item)
    return pin.Model(), visuals


def box_stl(path: Path) -> Path:
    """A binary STL tetrahedron."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
    faces = [0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[face].ravel(), 0) for face in faces)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", 4) + body)
    return path


DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.5" name="half"/></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert>
<diffuse><color>0 0.8 0 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="n" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array><technique_common>
<accessor source="#n" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1" material="s"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>0 0 2</translate><rotate>0 0 1 90</rotate>
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
