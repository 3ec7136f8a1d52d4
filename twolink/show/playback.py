"""A motion as one page of HTML that plays in any browser: it holds the viewer, the robot and the motion. The page is
saved, or served to this machine while it plays.
"""

import base64
import functools
import gzip
import html
import importlib.metadata
import json
import re
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Names, texts
from twolink.errors import ShowError, require_known
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.show.meshcat_scene import require_pieces, scene_nodes
from twolink.show.meshcat_shapes import Floats, Json
from twolink.show.viewer_data import (
    Contacts,
    check_motion,
    contact_data,
    joint_frames,
    motion_data,
    resample,
    robot_data,
)

VIEWER = Path(__file__).with_name("viewer")
_MODULES = ("elements", "motion", "robot", "overlays", "stage", "timeline", "viewer")  # each after those it imports
_RATE = 60.0  # frames per second of playing
_MIN_FRAMES = 30  # with fewer a motion cannot be recognized
_FRAME_BYTES = 40  # of a joint in a frame: seven numbers of four bytes in base64, which compresses a little
_PAGE_BYTES = 50_000  # of the page without meshcat's script, bodies and motion
_QUICK = 6  # of gzip's levels
Run = tuple[pin.Model, pin.GeometryModel, ArrayLike, ArrayLike]
_LIMITS: dict[str, Any] = {"max_frames": 36_000, "max_bytes": 500_000_000}  # higher than a file's: the page is not kept

_BLOCK = 0.2  # seconds


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
    require_format(path_to_write(path), (".html",), ShowError)
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
    events: Sequence[tuple[float, str]] = (),
    contacts: Contacts | None = None,
    forces: Contacts | None = None,
    trails: Names | None = None,
    beside: Run | None = None,
    beside_title: str = "compared run",
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
    events : sequence of (float, str)
        Times in s with what happens then: marks on the time line.
    contacts : mapping, optional
        By pair of bodies, its contacts at the times t: points (n, k, 3), m, and forces (n, k, 3), N, NaN where it is
        apart.
    forces : mapping, optional
        In the same form, other forces by name.
    trails : str or sequence of str, optional
        Links that draw a trail at first; by default the last link, where there is one.
    beside : (model, visuals, t, q), optional
        A motion to lay over this one as a ghost, with the title `beside_title`.
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
    robot, nodes, skipped = _robot(model, visuals)
    require_pieces(nodes, skipped, on_skipped, "playback")
    chosen = None if trails is None else _known(trails, robot["frames"])
    fixed = len(viewer_script()) + _PAGE_BYTES + len(_compressed(robot))
    affordable = int(max_bytes - fixed) // (_FRAME_BYTES * model.njoints)
    shown, note = choose_frames(times, speed, min(max_frames, max(affordable, _MIN_FRAMES)))
    path = resample(model, times, configurations, shown)
    motion = motion_data(model, shown, path) | {
        "events": [{"t": float(at), "text": text} for at, text in events],
        "contacts": contact_data(times, contacts or {}, shown),
        "forces": contact_data(times, forces or {}, shown),
    }
    film = {"visuals": robot, "motion": motion, "speed": speed, "live": live, "trails": chosen}
    if beside is not None:
        film["ghost"] = _ghost(beside, model, len(shown)) | {"title": beside_title}
    notes = [note, f"not drawn: {', '.join(skipped)}" if skipped else ""]
    page = _page(film, title, " · ".join(filter(None, notes)))
    if len(page) > max_bytes:
        what = f"the page would take {len(page) / 1e6:.1f} MB, more than max_bytes ({max_bytes / 1e6:.1f} MB)"
        remedy = "raise max_bytes, show a shorter part, or simplify the meshes"
        raise ShowError(what, where="playback", remedy=remedy, code="page-too-large", bytes=len(page))
    return page


def _robot(model: pin.Model, visuals: pin.GeometryModel) -> tuple[Json, list[Any], list[str]]:
    """A robot whose joints stand for its links, its pieces, and the names of those that cannot be drawn."""
    nodes, skipped = scene_nodes(visuals)
    frames = joint_frames(model)
    links = list(model.names)[1:]
    return robot_data(model, visuals, nodes) | {"links": links, "frames": frames, "skipped": skipped}, nodes, skipped


def _ghost(beside: Run, model: pin.Model, frames: int) -> Json:
    """The second motion, at as many times; without its robot where that is the first one's."""
    other, visuals, t, q = beside
    times, configurations = check_motion(other, t, q, 1.0)
    shown = np.linspace(times[0], times[-1], frames if len(times) > 1 else 1)
    motion = motion_data(other, shown, resample(other, times, configurations, shown))
    return {"motion": motion, "visuals": None if other is model else _robot(other, visuals)[0]}


def _known(trails: Names, frames: Sequence[Json]) -> list[str]:
    names = [frame["name"] for frame in frames]
    chosen = texts(trails, "trails", ShowError, "give the names of links")
    for name in chosen:
        require_known(name, names, ShowError, "there is no moving link {!r}", where="playback", argument="trails")
    return chosen


def choose_frames(t: Floats, speed: float, max_frames: int) -> tuple[Floats, str]:
    """The times to show, and a note for the viewer when they are fewer than 60 per second of playing.

    The times (n,), n <= `max_frames`, are at equal distances, and the first and last sample are among them.
    """
    seconds = float(t[-1] - t[0]) / speed
    wanted = 1 + max(1, round(seconds * _RATE)) if len(t) > 1 else 1
    count = min(wanted, max_frames)
    note = f"shown at {(count - 1) / seconds:.3g} frames a second" if count < wanted else ""
    return np.linspace(t[0], t[-1], count), note


def _page(film: Json, title: str, notes: str) -> bytes:
    """The page as UTF-8. Texts from outside enter it as base64 or as escaped HTML."""
    parts = {
        "TITLE": html.escape(title),
        "NOTES": html.escape(notes),
        "STYLE": (VIEWER / "viewer.css").read_text("utf-8"),
        "FILM": base64.b64encode(_compressed(film)).decode("ascii"),
        "MESHCAT": viewer_script().replace("</script", "<\\/script").replace("<!--", "<\\!--"),
        "VIEWER": _modules(),
    }
    template = Path(__file__).with_name("playback.html").read_text("utf-8")
    pieces = template.split("%%")  # every second one is a name; no inserted part is itself searched for names
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces)).encode("utf-8")


def _compressed(data: Json) -> bytes:
    return gzip.compress(json.dumps(data, allow_nan=False).encode(), _QUICK, mtime=0)


@functools.cache
def _modules() -> str:
    """The viewer's modules as one: a page that is a file may import no other."""
    texts = [(VIEWER / f"{name}.js").read_text("utf-8") for name in _MODULES]
    return "\n".join(re.sub(r"^(import .*|export )", "", text, flags=re.MULTILINE) for text in texts)


@functools.cache
def viewer_script() -> str:
    """meshcat's viewer, three.js included, as the installed package has it (importing meshcat would import IPython)."""
    file = importlib.metadata.distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    return Path(str(file)).read_text("utf-8")


class _PageServer(ThreadingHTTPServer):
    """Serves one page, on this machine only."""

    def __init__(self, page: bytes) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.page = page
        self.started = threading.Event()  # a browser has the page and plays it

    def handle_error(self, *_: Any) -> None:
        """Ignore a browser that goes away."""


class _Handler(BaseHTTPRequestHandler):
    server: _PageServer

    def do_GET(self) -> None:
        """Answer / with the page, and /started with nothing."""
        if self.path == "/started":
            self.server.started.set()
        body = self.server.page if self.path == "/" else b""
        self.send_response(200 if self.path in ("/", "/started") else 404)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


def _wait(event: threading.Event, seconds: float) -> bool:
    """True if the event comes within so many seconds.

    Python sees a Ctrl-C only between two of its instructions. One that comes just before the thread blocks, or that the
    system gives to another thread, does not end the block: so no block is long.
    """
    end = time.monotonic() + seconds
    while not event.wait(max(0.0, min(_BLOCK, end - time.monotonic()))):
        if time.monotonic() >= end:
            return False
    return True


def play_live(
    model: pin.Model,
    visuals: pin.GeometryModel,
    t: ArrayLike,
    q: ArrayLike,
    *,
    speed: float = 1.0,
    open_browser: bool = True,
    wait: float = 60.0,
    on_url: Callable[[str], None] | None = None,
    **options: Any,
) -> None:
    """Play the motion q(t) once in a browser; return when it has ended.

    A slow machine shows fewer pictures, but never a slower motion. The server has ended when this returns or raises;
    the page goes on without it.

    Parameters
    ----------
    model, visuals, t, q, speed
        As in `playback_page`.
    open_browser : bool
        Whether to open the page in the user's browser.
    wait : float
        Seconds to wait for a browser to play the page.
    on_url : callable, optional
        Called with the page's address.
    options
        The other arguments of `playback_page`.

    Raises
    ------
    ShowError
        For a motion that cannot be shown, and when no browser comes (code "no-browser").
    """
    page = playback_page(model, visuals, t, q, speed=speed, live=True, **_LIMITS, **options)
    with _PageServer(page) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/"
        try:
            if on_url is not None:
                on_url(url)
            if open_browser:  # in a thread, because a browser in the terminal returns only when it is closed
                threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
            if not _wait(server.started, wait):
                what = f"no browser opened {url} within {wait:g} s"
                remedy = 'try again, or write a page that any browser opens: run.playback("motion.html")'
                raise ShowError(what, where="live playback", remedy=remedy, code="no-browser")
            _wait(threading.Event(), float(np.ptp(np.asarray(t, float))) / speed)
        finally:
            server.shutdown()
