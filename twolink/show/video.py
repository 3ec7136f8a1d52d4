"""A motion as a film (.mp4, .webm, .gif), or a moment of it as a picture (.png), without a display."""

import itertools
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twolink.errors import ShowError, import_extra
from twolink.io.files import path_to_write, write_atomic
from twolink.io.progress import Report
from twolink.io.tables import require_format
from twolink.show.figure import COLOURS, new_figure, plain
from twolink.show.meshcat_scene import look_at, poses, require_pieces
from twolink.show.raycasting import CONTACT_COLOUR, FORCE_COLOUR, Arrows, Camera, Picture
from twolink.show.surfaces import Floats, surfaces
from twolink.show.viewer_data import Contacts, check_motion, resample, time_digits

FORMATS = (".mp4", ".webm", ".gif", ".png")
CODECS = {".mp4": "libx264", ".webm": "libvpx-vp9"}
SMALLEST, LARGEST = 64, 4096  # pixels of a side
CURVES = 0.75  # width of the curves beside the picture, of its height
WHOLE = 600  # configurations that decide from where the camera sees the whole motion
ARROW_COLOURS = (CONTACT_COLOUR, FORCE_COLOUR)  # thin, and of few of the pixels that decide on a palette
GIF_RATE = 25.0  # pictures a second; a .gif counts in hundredths of a second
Image = NDArray[np.uint8]


def write_video(
    model: Any,
    visuals: Any,
    t: ArrayLike,
    q: ArrayLike,
    path: str | Path,
    *,
    size: tuple[int, int] = (960, 720),
    rate: float = 30.0,
    speed: float = 1.0,
    at: float | None = None,
    direction: ArrayLike | None = None,
    curves: Mapping[str, Floats] | None = None,
    contacts: Contacts | None = None,
    forces: Contacts | None = None,
    touches: bool = False,
    progress: Report | None = None,
    on_skipped: Callable[[list[str]], None] | None = None,
) -> Path:
    """Write the motion q(t) of a robot as a film, or one moment of it as a picture.

    Parameters
    ----------
    model, visuals : pin.Model, pin.GeometryModel
        The robot.
    t : array_like (n,)
        Times in s, increasing.
    q : array_like (n, nq)
        Configurations.
    path : str or Path
        .mp4 and .webm need the package imageio-ffmpeg (pip install twolink[video]), .gif and .png nothing more.
    size : (width, height)
        Pixels of the robot's picture, even numbers.
    rate : float
        Pictures a second; 25 at most for a .gif.
    speed : float
        Simulated seconds a second of playing.
    at : float, optional
        The time of a .png, s; by default the first.
    direction : array_like (3,), optional
        From the robot to the camera; by default as the playback looks.
    curves : mapping of name to array (n,), optional
        Quantities to draw over time beside the picture.
    contacts, forces : mapping of name to (points, forces), (n, k, 3) each, optional
        Forces to draw as arrows, m and N at the times t, NaN where none acts: of contacts, and of others.
    touches : bool
        Bodies touch the ground, which is then drawn at the lowest point of the motion, and otherwise below.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here pictures.
    on_skipped : callable, optional
        Called with the names of pieces that cannot be drawn, if any.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ShowError
        For a motion or a size that cannot be shown, another ending, or a package that is not installed.
    """
    path = path_to_write(path)
    kind = require_format(path, FORMATS, ShowError)
    _check(size, rate)
    times, configurations = check_motion(model, t, q, speed)
    encoder = import_extra("imageio_ffmpeg", "video") if kind in CODECS else None
    drawn, skipped = surfaces(visuals)
    require_pieces(drawn, skipped, on_skipped, "video")
    rate = min(rate, GIF_RATE) if kind == ".gif" else rate
    shown = _moments(times, speed, rate, at, kind)
    along = resample(model, times, configurations, np.unique(np.concatenate([shown, times[:: len(times) // 300 + 1]])))
    camera = Camera(look_at(drawn, poses(model, visuals, along, drawn), direction, touches=touches), size)
    picture = Picture(model, visuals, drawn, camera)
    arrows = Arrows(camera, times, shown, contacts or {}, forces or {})
    beside = _curves(times, curves, size[1]) if curves else None

    def made() -> Iterator[Image]:
        for k, (moment, configuration) in enumerate(
            zip(shown.tolist(), resample(model, times, configurations, shown), strict=True)
        ):
            image = _labelled(arrows.over(picture.of(configuration), k), f"t = {moment:.{time_digits(shown)}f} s")
            yield np.hstack([image, beside(moment)]) if beside else image
            if progress is not None:
                progress(k + 1, len(shown), f"picture {k + 1} of {len(shown)}")

    if encoder is not None:
        return _encode(encoder, made(), path, rate, kind)
    return write_atomic(path, lambda file: _save(made(), file, rate, kind), error=ShowError)


def _check(size: tuple[int, int], rate: float) -> None:
    if len(size) != 2 or not all(SMALLEST <= side <= LARGEST and side % 2 == 0 for side in size):
        what = f"size is {'x'.join(map(str, size))}, expected even numbers from {SMALLEST} to {LARGEST}"
        raise ShowError(what, where="video", remedy="such as 960x720", argument="size")
    if not (isinstance(rate, float | int | np.number) and 0.0 < rate <= 240.0):
        what = f"rate is {rate!s:.60}, expected a number above 0, and up to 240"
        raise ShowError(what, where="video", remedy="30 pictures a second are usual", argument="rate")


def _moments(t: Floats, speed: float, rate: float, at: float | None, kind: str) -> Floats:
    """The times of the pictures, s."""
    if kind == ".png":
        moment = float(t[0]) if at is None else at
        if not (isinstance(moment, float | int | np.number) and t[0] <= moment <= t[-1]):
            what = f"at is {moment!s:.60} s, expected a time from {t[0]:g} to {t[-1]:g} s"
            raise ShowError(what, where="video", remedy="choose a time of the run", argument="at")
        return np.array([moment])
    if at is not None:
        raise ShowError("at is the time of one picture", where="video", remedy="write a .png", argument="at")
    count = 1 + max(1, round(float(t[-1] - t[0]) / speed * rate))
    return np.asarray(np.minimum(t[0] + np.arange(count) * speed / rate, t[-1]))


def _labelled(image: Image, text: str) -> Image:
    """The picture with a text in its lower left corner."""
    from matplotlib import font_manager
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    height = max(12, len(image) // 32)
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), height)
    drawn = Pillow.fromarray(image)
    ImageDraw.Draw(drawn).text((height, len(image) - 2 * height), text, fill=(60, 66, 74), font=font)
    return np.asarray(drawn)


def _curves(t: Floats, curves: Mapping[str, Floats], height: int) -> Callable[[float], Image]:
    """A function of time that gives the picture of all curves with a line at that time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    width = 2 * round(CURVES * height / 2)
    figure, axes = new_figure(len(curves), size=(width / 100, height / 100), sharex=True)
    figure.set_dpi(100)
    for k, (axis, (name, values)) in enumerate(zip(axes[:, 0], curves.items(), strict=True)):
        axis.plot(t, values, color=COLOURS[k % len(COLOURS)], linewidth=1.4)
        axis.set_title(plain(name), fontsize=9, loc="left")
        axis.tick_params(labelsize=8)
    axes[-1, 0].set_xlabel("t (s)", fontsize=9)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    base = np.asarray(canvas.buffer_rgba())[:height, :width, :3]
    boxes = [axis.get_window_extent() for axis in axes[:, 0]]
    place = axes[0, 0].transData

    def at(moment: float) -> Image:
        image = base.copy()
        column = int(np.clip(place.transform((moment, 0.0))[0], 0, width - 1))
        for box in boxes:
            image[int(height - box.y1) : int(height - box.y0), column] = (110, 116, 124)
        return image

    return at


def _save(images: Iterable[Image], file: BinaryIO, rate: float, kind: str) -> None:
    """Write a .png or .gif."""
    from PIL import Image as Pillow

    first, *rest = (Pillow.fromarray(image) for image in images)
    if kind == ".png":
        first.save(file, "PNG")
        return
    palette = _palette([first, *rest])
    frames = [image.quantize(palette=palette, dither=Pillow.Dither.NONE) for image in (first, *rest)]
    ends = np.round(100 * np.arange(len(frames) + 1) / rate)  # whole hundredths of a second
    frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=(10 * np.diff(ends)).tolist(), loop=0)


def _palette(images: Sequence[Any]) -> Any:
    """The 256 colours of a .gif, one palette for all pictures: colours that differ from one to the next flicker."""
    from PIL import Image as Pillow

    some = [np.asarray(image)[::4, ::4] for image in images[:: len(images) // 8 + 1]]
    palette = Pillow.fromarray(np.concatenate(some)).quantize(256 - len(ARROW_COLOURS))
    own = (palette.getpalette() or [])[: 3 * (256 - len(ARROW_COLOURS))]
    palette.putpalette([*own, *itertools.chain(*ARROW_COLOURS)])
    return palette


def _encode(ffmpeg: Any, images: Iterator[Image], path: Path, rate: float, kind: str) -> Path:
    """Write a .mp4 or .webm."""
    first = next(images)
    height, width = first.shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder, f"film{kind}")
        options = {"fps": rate, "codec": CODECS[kind], "macro_block_size": 2, "ffmpeg_log_level": "error"}
        writer = ffmpeg.write_frames(str(part), (width, height), **options)
        writer.send(None)
        try:
            for image in itertools.chain([first], images):
                writer.send(image.tobytes())
        finally:
            writer.close()
        return write_atomic(path, lambda file: file.write(part.read_bytes()), error=ShowError)
