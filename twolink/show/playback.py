"""A motion as one HTML file that plays in any browser, with no network and no server.

meshcat's viewer, its scene and its animation are all inside the file, which is made without meshcat's server.
"""

from __future__ import annotations

import base64
import functools
import html
import importlib.util
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import ArrayLike

from twolink.errors import MissingExtraError, ShowError, TwolinkError
from twolink.io.atomic import write_atomic
from twolink.show.meshcat_scene import Node, poses, scene_nodes, set_object, set_pose
from twolink.show.meshcat_shapes import Floats, Json, packed
from twolink.show.meshcat_view import Side, View, check_motion, look_at, resample, stage, to_three

_ASPECT = 1.6  # width to height, until the page knows its own
_FEWEST_FRAMES = 30  # a motion squeezed into fewer is not shown but hidden
_TRACKS = (("position", "vector3", slice(0, 3)), ("quaternion", "quaternion", slice(3, 7)))
_STILL = 1e-7  # m, and in quaternions: less than this is no motion


@dataclass(frozen=True, slots=True)
class Frames:
    """When the pictures are taken: simulated times at equal distances, both ends among them."""

    times: Floats  # (n,) s
    rate: float  # a second of playing
    note: str  # what the viewer should know about it, or ""


def write_playback(
    model: Any,
    visuals: Any,
    t: ArrayLike,
    q: ArrayLike,
    path: str | Path,
    *,
    title: str = "twolink",
    speed: float = 1.0,
    fps: float = 60.0,
    max_frames: int = 3600,
    max_bytes: int = 50_000_000,
    view: Side = "auto",
    on_skipped: Callable[[list[str]], None] | None = None,
) -> Path:
    """Write the motion q(t) of a robot as a page that plays it over and over, and return the page's path.

    model is a pin.Model, visuals its pin.GeometryModel of visual geometry, t (n,) s increasing, q (n, nq).
    `speed` is simulated seconds a second of playing. There are `fps` frames a second, fewer if that made
    more than `max_frames` or more than `max_bytes`; the page says so then. `view`: "auto" looks square at a
    motion in a plane and slantwise at any other. `on_skipped` is called with the names of the pieces that
    cannot be drawn, if any; the page says so too. Raises ShowError for a motion that cannot be shown, a
    page that would be too large, or a path that cannot be written.
    """
    times, configurations = check_motion(model, t, q, speed)
    if not (fps > 0 and max_frames >= 2):
        remedy = "60 and 3600 are the usual ones"
        raise ShowError(f"fps is {fps} and max_frames {max_frames}", where="playback", remedy=remedy)
    nodes, skipped = scene_nodes(visuals)
    if skipped and on_skipped is not None:
        on_skipped(skipped)
    if not nodes:
        remedy = "give its links <visual> elements"
        raise ShowError("the robot has nothing to draw", where=str(path), remedy=remedy)
    frames = choose_frames(times, speed, fps, max_frames)
    placed = poses(model, visuals, resample(model, times, configurations, frames.times), nodes)
    seen = look_at(nodes, placed, view)
    still = [set_object(node.path, node.object) for node in nodes] + stage(seen, _ASPECT)
    still += [set_pose(node.path, placed[0, k]) for k, node in enumerate(nodes)]
    fixed = _page(still, title, seen, frames, speed, skipped)
    frames, placed = _fit(frames, placed, len(nodes), max_bytes - len(fixed))
    moving = animation(nodes, placed, (frames.times - frames.times[0]) / speed)
    page = _page(still + ([moving] if moving else []), title, seen, frames, speed, skipped)
    if len(page) > max_bytes:
        what = f"the page would take {len(page) / 1e6:.1f} MB, more than max_bytes ({max_bytes / 1e6:.1f} MB)"
        remedy = "raise max_bytes, show a shorter part, or simplify the meshes"
        raise ShowError(what, where=str(path), remedy=remedy)
    try:
        return write_atomic(Path(path), lambda file: file.write(page))
    except TwolinkError as failure:
        raise ShowError(failure.what, where=failure.where, remedy=failure.remedy) from None


def choose_frames(t: Floats, speed: float, fps: float, most: int) -> Frames:
    """The instants to show: `fps` a second of playing, but not more than `most` in all."""
    seconds = float(t[-1] - t[0]) / speed
    wanted = 1 + max(1, round(seconds * fps)) if len(t) > 1 else 1
    return _spread(float(t[0]), float(t[-1]), seconds, min(wanted, most), reduced=wanted > most)


def _spread(start: float, end: float, seconds: float, count: int, *, reduced: bool) -> Frames:
    rate = (count - 1) / seconds if count > 1 else 0.0
    note = f"shown at {rate:.3g} frames a second" if reduced else ""
    return Frames(np.linspace(start, end, count), rate, note)


def _fit(frames: Frames, placed: Floats, bodies: int, room: int) -> tuple[Frames, Floats]:
    """Drop frames until the animation needs at most `room` bytes: 36 a body and frame, in base64 48."""
    affordable = int(room / (36 * 4 / 3 * bodies)) - 20
    count = len(frames.times)
    if count <= max(affordable, _FEWEST_FRAMES):
        return frames, placed  # if even that is too much, the caller's own count of the bytes says so
    every = -(-(count - 1) // max(affordable - 1, _FEWEST_FRAMES))
    kept = np.unique(np.append(np.arange(0, count - every // 2, every), count - 1))
    seconds = (count - 1) / frames.rate
    rate = (len(kept) - 1) / seconds
    return Frames(frames.times[kept], rate, f"shown at {rate:.3g} frames a second"), placed[kept]


def animation(nodes: Sequence[Node], placed: Floats, times: Floats) -> Json | None:
    """The command that animates what moves, for ever: placed (n, len(nodes), 7), times (n,) s from 0."""
    animations = []
    for k, node in enumerate(nodes):
        tracks = []
        for name, kind, part in _TRACKS:
            values = placed[:, k, part]
            if np.ptp(values, axis=0).max() > _STILL:
                # Typed arrays take 4 bytes a number; lists of keys, as meshcat's Python writes, take 20.
                numbers = {"times": packed(times), "values": packed(values)}
                tracks.append({"name": f".{name}", "type": kind, **numbers})
        if tracks:
            animations.append({"path": node.path, "clip": {"fps": 1, "name": "default", "tracks": tracks}})
    if not animations:
        return None
    options = {"play": True, "repetitions": float("inf")}
    return {"type": "set_animation", "animations": animations, "options": options, "path": ""}


def _page(
    commands: Sequence[Json], title: str, view: View, frames: Frames, speed: float, skipped: Sequence[str]
) -> bytes:
    """The page as UTF-8. What comes from outside enters it as base64, escaped HTML, or JSON without "<"."""
    facts = {
        "start": float(frames.times[0]),
        "duration": float(frames.times[-1] - frames.times[0]) / speed,
        "speed": speed,
        "distances": [[aspect, view.distance(aspect)] for aspect in np.geomspace(0.3, 4.0, 24).tolist()],
        "direction": to_three(view.direction),
    }
    notes = [f"speed {speed:g}×"] if speed != 1.0 else []
    notes += [frames.note] if frames.note else []
    notes += [f"grid {view.cell:g} m"]
    notes += [f"not drawn: {', '.join(skipped)}"] if skipped else []
    blobs = "\n".join(base64.b64encode(umsgpack.packb(command)).decode("ascii") for command in commands)
    parts = {
        "TITLE": html.escape(title),
        "NOTES": html.escape(" · ".join(notes)),
        "FACTS": json.dumps(facts).replace("<", "\\u003c"),
        "COMMANDS": blobs,
        "VIEWER": viewer_script().replace("</script", "<\\/script").replace("<!--", "<\\!--"),
    }
    template = Path(__file__).with_name("playback.html").read_text("utf-8")
    pieces = template.split("%%")  # odd ones are names; one pass: no part is itself searched
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces)).encode("utf-8")


@functools.cache
def viewer_script() -> str:
    """meshcat's viewer, three.js included, as the installed package has it. Raises MissingExtraError without it."""
    package = importlib.util.find_spec("meshcat")  # not imported: meshcat imports IPython
    if package is None or not package.submodule_search_locations:
        raise MissingExtraError("meshcat is not installed", remedy="pip install meshcat")
    return Path(package.submodule_search_locations[0], "viewer", "dist", "main.min.js").read_text("utf-8")
