"""Writing robots, scenes and runs in formats that other programs read: one function, by the ending of the file."""

import importlib
import os
from pathlib import Path
from typing import Any

from twolink.dynamics import Robot
from twolink.errors import QueryError
from twolink.io.files import path_to_write
from twolink.io.tables import require_format
from twolink.scenes import Scene
from twolink.simulation.trajectory import Trajectory

WRITERS = {  # what is written, by what it is and its ending: module and function of this room
    (Robot, ".c"): ("twolink.parts.exchange.c_code", "export_c"),
    (Robot, ".urdf"): ("twolink.parts.exchange.urdf_text", "export_urdf"),
    (Robot, ".xml"): ("twolink.parts.exchange.mjcf_text", "export_mjcf"),
    (Robot, ".mjcf"): ("twolink.parts.exchange.mjcf_text", "export_mjcf"),
    (Scene, ".fmu"): ("twolink.parts.exchange.fmu", "export_fmu"),
}


def export(thing: Robot | Scene | Trajectory, path: str | os.PathLike[str], **options: Any) -> Path:
    """Write a robot, a scene or a run to a file in another format, by the file's ending.

    Parameters
    ----------
    thing : Robot, Scene or Trajectory
        A robot is written as .urdf, as .xml (MJCF), or as .c (C99 functions); a scene as .fmu (FMI 3.0); a run as
        `Trajectory.save` writes it.
    path : str or path
        The file.
    **options
        functions, of .c: names of queries and "step:METHOD". parameters and platforms, of .fmu.

    Returns
    -------
    Path
        The file; the header of .c stands beside it.

    Raises
    ------
    QueryError
        Nothing of this kind is written, or not to files of this ending (code "unknown-format").
    TwolinkError
        As the format's own writer says.

    Examples
    --------
    >>> import tempfile, twolink as tl
    >>> folder = tempfile.mkdtemp()
    >>> tl.export(tl.load_robot("arm"), f"{folder}/arm.urdf").name
    'arm.urdf'
    """
    if isinstance(thing, Trajectory):
        return thing.save(path, **options)
    endings = {ending: place for (kind, ending), place in WRITERS.items() if isinstance(thing, kind)}
    if not endings:
        raise QueryError(f"expected a robot, a scene or a run, got {type(thing).__name__}", argument="thing",
                         remedy="such as tl.load_robot(...)")  # fmt: skip
    module, function = endings[require_format(path_to_write(path), endings, QueryError)]
    written = getattr(importlib.import_module(module), function)(thing, path, **options)
    return Path(written[0] if isinstance(written, tuple) else written)
