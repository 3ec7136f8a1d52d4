"""URDFs and archives for uploads and queries, good ones."""

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from tests.robots.test_bad_urdf import INERTIAL, JOINT

URDFS = Path(__file__).parents[3] / "urdf"


def pendulum(visual: str = "", name: str = "r") -> str:
    return f'<robot name="{name}">\n<link name="base"/>\n<link name="arm">{INERTIAL}{visual}</link>\n{JOINT}</robot>'


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
