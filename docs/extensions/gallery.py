"""The gallery: pages that play the bundled scenes and hard cases, with a picture of each, made before a full build."""

import html
import logging as python_logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from docutils import nodes
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import twolink as tl
from twolink.errors import AccuracyError, TwolinkError
from twolink.hard import SimulationCase, all_cases

FOLDER = "playback"
SECONDS = 8.0  # to play a motion; slow or fast motion for others
MOMENT = 0.3  # of the motion, which its picture shows
SIZE = (480, 360)  # of a picture, pixels
log = logging.getLogger(__name__)


class Entry(NamedTuple):
    """A motion of the gallery. key: the name of its files. run: simulates it."""

    key: str
    name: str
    title: str
    run: Callable[[], tl.Trajectory]


def scene_entries() -> Iterator[Entry]:
    """The bundled scenes."""
    for scene in tl.scenes():
        name = str(scene["name"])
        yield Entry(name, name, str(scene["title"]), lambda name=name: tl.simulate(tl.load_scene(name)))


def case_entries() -> Iterator[Entry]:
    """The hard cases that are simulated, without the slow ones."""
    for case in all_cases():
        if isinstance(case, SimulationCase) and not case.slow:
            yield Entry(f"case-{case.name}", case.name, case.title, lambda case=case: solved(case))


def solved(case: SimulationCase) -> tl.Trajectory:
    """The motion of a hard case at its first setting, as far as it can be trusted."""
    try:
        return tl.simulate(case.load(), case.duration, **case.settings[0])
    except AccuracyError as error:
        if isinstance(error.run, tl.Trajectory):
            return error.run
        raise


def write_entry(folder: Path, entry: Entry) -> None:
    """Write an entry's page and its picture; neither where its robot has nothing to draw, or the case is refused."""
    try:
        run = entry.run()
        speed = float(f"{run.t[-1] / SECONDS:.1g}")
        run.video(folder / f"{entry.key}.png", size=SIZE, at=MOMENT * float(run.t[-1]))
        run.playback(folder / f"{entry.key}.html", speed=1.0 if 0.3 < speed < 2 else speed)
    except TwolinkError as error:
        log.info("%s has no picture: %s", entry.name, error)


def write_playbacks(app: Any) -> None:
    """Write all pages and pictures into the site."""
    if not app.config.twolink_playbacks:
        return
    python_logging.getLogger("twolink").setLevel(python_logging.WARNING)
    folder = Path(app.outdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for entry in (*scene_entries(), *case_entries()):
        write_entry(folder, entry)
        log.info("%s plays", entry.name)


def picture(app: Any, key: str, title: str) -> str:
    """An entry's picture, which leads to the page that plays it, for a generated page; "" where there is none."""
    if not (Path(app.outdir) / FOLDER / f"{key}.png").exists():
        return ""
    file, text = f"../{FOLDER}/{key}", html.escape(title, quote=True)
    return f'<a class="motion" href="{file}.html"><img src="{file}.png" alt="{text}" loading="lazy"></a>'


class Gallery(SphinxDirective):
    """Links to the pages that play, which open in one frame: browsers have few contexts for 3D."""

    def run(self) -> list[nodes.Node]:
        """The frame and the lists."""
        made = Path(self.env.app.outdir) / FOLDER
        full = self.config.twolink_playbacks
        lists = ""
        for title, entries in (("Scenes", scene_entries()), ("Hard cases", case_entries())):
            items = (self.item(entry) for entry in entries if not full or (made / f"{entry.key}.html").exists())
            lists += f'<h2>{title}</h2><ul class="gallery">{"".join(items)}</ul>'
        first = f"{FOLDER}/{next(scene_entries()).key}.html"
        frame = f'<iframe class="player" name="player" src="{first}" title="A robot that plays"></iframe>'
        return [nodes.raw("", frame + lists, format="html")]

    def item(self, entry: Entry) -> str:
        """A link with a picture, where there is one."""
        file = f"{FOLDER}/{entry.key}"
        shown = f'<img src="{file}.png" alt="" loading="lazy">' if self.config.twolink_playbacks else ""
        text = f"<strong>{entry.name}</strong>{html.escape(entry.title)}"
        return f'<li><a href="{file}.html" target="player">{shown}{text}</a></li>'


def setup(app: Any) -> dict[str, bool]:
    """Register the directive and the option."""
    app.add_config_value("twolink_playbacks", True, "env", bool)
    app.add_directive("gallery", Gallery)
    app.connect("builder-inited", write_playbacks, priority=400)  # the catalogues, made then too, show the pictures
    return {"parallel_read_safe": True, "parallel_write_safe": True}
