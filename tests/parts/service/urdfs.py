"""URDFs and archives for uploads and queries, good ones."""

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

URDFS = Path(__file__).parents[3] / "urdf"
INERTIAL = """<inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def pendulum(visual: str = "", name: str = "r") -> str:
    joint = """<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    return f'<robot name="{name}">\n<link name="base"/>\n<link name="arm">{INERTIAL}{visual}</link>\n{joint}</robot>'


def mesh(filename: str) -> str:
    return f'<visual><geometry><mesh filename="{filename}"/></geometry></visual>'


def stl() -> bytes:
    """One triangle."""
    return bytes(80) + struct.pack("<I12fH", 1, *(0, 0, 1), *(0, 0, 0), *(1, 0, 0), *(0, 1, 0), 0)


def zipped(files: dict[str, bytes | str], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def packed(**arrays: Any) -> bytes:
    """The arrays as .npz."""
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()
