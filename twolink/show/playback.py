"""A motion as one page of HTML that plays in any browser: it holds meshcat's viewer, the scene and the animation."""

import base64
import functools
import html
import importlib.metadata
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import umsgpack
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.io.atomic import write_atomic
from twolink.io.tables import require_format
from twolink.show.meshcat_scene import Node, poses, require_pieces, scene_nodes
from twolink.show.meshcat_shapes import Floats, Json, packed
from twolink.show.meshcat_view import look_at, opening_commands, to_three
from twolink.show.motion_samples import check_motion, resample, time_digits

_RATE = 60.0  # frames per second of playing
_MIN_FRAMES = 30  # with fewer a motion cannot be recognized
_FRAME_BYTES = 48  # of a body in a frame: seven numbers and the time twice, four bytes each, in base64
_PAGE_BYTES = 50_000  # of the page without viewer, bodies and animation
_TRACKS = (("position", "vector3", slice(0, 3)), ("quaternion", "quaternion", slice(3, 7)))
_AT_REST = 1e-7  # m, and in quaternions: a smaller range is no motion


@dataclass(frozen=True, repr=False)
class InlinePage:
    """A page, in UTF-8, that notebooks show in a frame."""

    page: bytes

    def _repr_html_(self) -> str:
        style = "width: 100%; height: 480px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.page.decode("utf-8"))}" style="{style}"></iframe>'


def write_playback(
    model: pin.Model, visuals: pin.GeometryModel, t: ArrayLike, q: ArrayLike, path: str | Path, **options: Any
) -> Path:
    """Write the motion q(t) of a robot as an .html file that plays it again and again. Returns its path.

    The arguments are those of `playback_page`. Raises ShowError also for another ending than .html (code
    "unknown-format"), and for a path that cannot be written.
    """
    require_format(Path(path), (".html",), ShowError)
    page = playback_page(model, visuals, t, q, **options)
    return write_atomic(Path(path), lambda file: file.write(page), error=ShowError)


def playback_page(
    model: pin.Model,
    visuals: pin.GeometryModel,
    t: ArrayLike,
    q: ArrayLike,
    *,
    title: str = "twolink",
    speed: float = 1.0,
    max_frames: int = 3600,
    max_bytes: int = 50_000_000,
    live: bool = False,
    on_skipped: Callable[[list[str]], None] | None = None,
) -> bytes:
    """The page that plays the motion q(t) of a robot.

    Parameters
    ----------
    model : pin.Model
        The robot.
    visuals : pin.GeometryModel
        Its visual geometry.
    t : array_like (n,)
        Times in s, increasing.
    q : array_like (n, nq)
        Configurations.
    title : str
        The page's title.
    speed : float
        Simulated seconds per second of playing.
    max_frames, max_bytes : int
        Limits. The motion is shown with fewer than 60 frames per second where it would exceed them, and the page says
        so.
    live : bool
        Whether the page plays once, and tells its server when it starts.
    on_skipped : callable, optional
        Called with the names of the pieces that cannot be drawn, if any. The page names them too.

    Returns
    -------
    bytes
        The page, in UTF-8. It needs no network.

    Raises
    ------
    ShowError
        For a motion that cannot be shown, and for a page that would be too large (code "page-too-large").
    """
    times, configurations = check_motion(model, t, q, speed)
    nodes, skipped = scene_nodes(visuals)
    require_pieces(nodes, skipped, on_skipped, "playback")
    fixed = len(viewer_script()) + _PAGE_BYTES + sum(len(_encoded(node.object)) for node in nodes)
    affordable = int(max_bytes - fixed) // (_FRAME_BYTES * len(nodes))
    shown, note = choose_frames(times, speed, min(max_frames, max(affordable, _MIN_FRAMES)))
    placed = poses(model, visuals, resample(model, times, configurations, shown), nodes)
    view = look_at(nodes, placed)
    commands = opening_commands(nodes, placed, view)
    commands += _animation(nodes, placed, (shown - times[0]) / speed, 1.0 if live else float("inf"))
    notes = [
        f"speed {speed:g}×" if speed != 1.0 else "",
        note,
        f"grid {view.cell:g} m",
        f"not drawn: {', '.join(skipped)}" if skipped else "",
    ]
    facts = {
        "start": float(shown[0]),
        "duration": float(shown[-1] - shown[0]) / speed,
        "speed": speed,
        "digits": time_digits(shown),
        "distances": [[aspect, view.distance(aspect)] for aspect in np.geomspace(0.3, 4.0, 24).tolist()],
        "direction": to_three(view.direction),
        "live": live,
    }
    page = _page(commands, title, " · ".join(filter(None, notes)), facts)
    if len(page) > max_bytes:
        what = f"the page would take {len(page) / 1e6:.1f} MB, more than max_bytes ({max_bytes / 1e6:.1f} MB)"
        remedy = "raise max_bytes, show a shorter part, or simplify the meshes"
        raise ShowError(what, where="playback", remedy=remedy, code="page-too-large", bytes=len(page))
    return page


def choose_frames(t: Floats, speed: float, max_frames: int) -> tuple[Floats, str]:
    """The times to show, and a note for the viewer when they are fewer than 60 per second of playing.

    The times (n,), n <= `max_frames`, are at equal distances, and the first and last sample are among them.
    """
    seconds = float(t[-1] - t[0]) / speed
    wanted = 1 + max(1, round(seconds * _RATE)) if len(t) > 1 else 1
    count = min(wanted, max_frames)
    note = f"shown at {(count - 1) / seconds:.3g} frames a second" if count < wanted else ""
    return np.linspace(t[0], t[-1], count), note


def _animation(nodes: Sequence[Node], placed: Floats, times: Floats, repetitions: float) -> list[Json]:
    """The command that animates the nodes that move; none when all are at rest.

    `placed` is (n, len(nodes), 7), `times` (n,) s of playing.
    """
    animations = []
    for k, node in enumerate(nodes):
        tracks = []
        for name, kind, columns in _TRACKS:
            values = placed[:, k, columns]
            if np.ptp(values, axis=0).max() > _AT_REST:
                # Typed arrays take 4 bytes a number; the lists of keys that meshcat's Python writes take 20.
                tracks.append({"name": f".{name}", "type": kind, "times": packed(times), "values": packed(values)})
        if tracks:
            animations.append({"path": node.path, "clip": {"fps": 1, "name": "default", "tracks": tracks}})
    options = {"play": True, "repetitions": repetitions}
    return [{"type": "set_animation", "animations": animations, "options": options, "path": ""}] if animations else []


def _page(commands: Sequence[Json], title: str, notes: str, facts: Json) -> bytes:
    """The page as UTF-8. Texts from outside enter it as base64, escaped HTML, or JSON without "<"."""
    parts = {
        "TITLE": html.escape(title),
        "NOTES": html.escape(notes),
        "FACTS": json.dumps(facts).replace("<", "\\u003c"),
        "COMMANDS": "\n".join(map(_encoded, commands)),
        "VIEWER": viewer_script().replace("</script", "<\\/script").replace("<!--", "<\\!--"),
    }
    template = Path(__file__).with_name("playback.html").read_text("utf-8")
    pieces = template.split("%%")  # every second one is a name; no inserted part is itself searched for names
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces)).encode("utf-8")


def _encoded(command: Json) -> str:
    """A command in base64, as the page holds it."""
    return base64.b64encode(umsgpack.packb(command)).decode("ascii")


@functools.cache
def viewer_script() -> str:
    """meshcat's viewer, three.js included, as the installed package has it (importing meshcat would import IPython)."""
    file = importlib.metadata.distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    return Path(str(file)).read_text("utf-8")
