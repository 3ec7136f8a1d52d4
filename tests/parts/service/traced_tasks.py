"""A task that loads and draws an upload, and tells which files were opened meanwhile; for tests."""

import os
import sys
from pathlib import Path
from typing import Any

import twolink
from twolink.parts.service.settings import Quotas
from twolink.parts.service.work.robot_tasks import RobotOptions, draw, receive
from twolink.robots.catalogue import our_urdfs

_PLACES = (sys.prefix, sys.base_prefix, twolink.__path__[0], our_urdfs(), "/usr/lib", "/proc/self")
_PROGRAM = [os.path.realpath(place) for place in _PLACES]
_opened: list[str] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        _opened.append(os.path.realpath(os.fsdecode(arguments[0])))


def upload(*, folder: str, kind: str, also: str) -> dict[str, Any]:
    """Receive the upload in `folder`, draw it, and open the file `also`, if it is named."""
    if not _opened:
        sys.addaudithook(_note)
    _opened.clear()
    robots = Path(folder).parent
    about = receive(folder=folder, kind=kind, options=RobotOptions(), quotas=Quotas(), ask=lambda _: {}).description
    refused = ""
    try:
        draw(key=Path(folder).name, robots=str(robots), path=str(Path(folder) / "visuals.json.gz"))
    except Exception as error:
        refused = str(error)
    if also:
        Path(also).read_bytes()
    outside = [path for path in _opened if not Path(path).is_relative_to(folder)]
    path_entries = [os.path.realpath(place) for place in sys.path]  # importlib.metadata looks for what is installed
    strange = [path for path in outside if not any(Path(path).is_relative_to(place) for place in _PROGRAM)]
    strange = [path for path in strange if path not in path_entries]
    return {"opened": strange, "inside": len(_opened) - len(outside), "refused": refused, "report": about["report"]}


TASKS = {"upload": upload}
