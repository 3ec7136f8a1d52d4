"""The gallery: a directive that lists the bundled scenes, and the pages that play them, made after a full build."""

import html
import logging as python_logging
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import twolink as tl

FOLDER = "playback"
SECONDS = 8.0  # to play a scene; slow or fast motion for others
log = logging.getLogger(__name__)


class Gallery(SphinxDirective):
    """Links to the pages that play the scenes, which open in one frame: browsers have few contexts for 3D."""

    def run(self) -> list[nodes.Node]:
        """The list and the frame."""
        entries = "".join(
            f'<li><a href="{FOLDER}/{scene["name"]}.html" target="player"><strong>{scene["name"]}</strong>'
            f"{html.escape(scene['title'])}</a></li>"
            for scene in tl.scenes()
        )
        first = tl.scenes().to_records()[0]["name"]
        frame = f'<iframe class="player" name="player" src="{FOLDER}/{first}.html" title="A robot that plays"></iframe>'
        return [nodes.raw("", f'{frame}<ul class="gallery">{entries}</ul>', format="html")]


def write_playbacks(app: Any, failure: Exception | None) -> None:
    """Simulate every bundled scene and write its page beside the site."""
    if failure is not None or not app.config.twolink_playbacks:
        return
    python_logging.getLogger("twolink").setLevel(python_logging.WARNING)
    folder = Path(app.outdir) / FOLDER
    folder.mkdir(exist_ok=True)
    for scene in tl.scenes():
        name = str(scene["name"])
        run = tl.simulate(tl.load_scene(name), accuracy=1e-6)
        speed = float(f"{run.t[-1] / SECONDS:.1g}")
        run.playback(folder / f"{name}.html", speed=1.0 if 0.3 < speed < 2 else speed)
        log.info("%s plays", name)


def setup(app: Any) -> dict[str, bool]:
    """Register the directive and the option."""
    app.add_config_value("twolink_playbacks", True, "env", bool)
    app.add_directive("gallery", Gallery)
    app.connect("build-finished", write_playbacks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
