"""Pictures of what accuracy costs by each method, measured on one scene before a full build."""

from pathlib import Path
from typing import Any

from sphinx.util import logging

import twolink as tl
from twolink.show.figure import COLOURS, new_figure, save_figure

FOLDER = "methods"
SCENE, SECONDS = "arm-swing", 2.0  # simulated
TOLERANCES = (1e-2, 1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
BUDGET = 0.1  # s that a run may take
METHODS = None  # all
ABOUT = (
    f"The pictures show `{SCENE}`, {SECONDS:g} s of it, solved by each method at several settings (blue) beside all "
    "others (grey): further down is more accurate, further left is quicker. Other scenes have other pictures: "
    "`twolink accuracy` draws yours."
)
log = logging.getLogger(__name__)


def write_pictures(app: Any) -> None:
    """Write a picture a method into the site: its errors over its seconds, and those of the others in grey."""
    folder = Path(app.outdir) / FOLDER
    if not app.config.twolink_playbacks or folder.exists():
        return
    settings = {"methods": METHODS, "tolerances": TOLERANCES, "repeats": 3, "budget": BUDGET}
    study = tl.accuracy_study(tl.load_scene(SCENE), SECONDS, **settings)
    folder.mkdir(parents=True)
    for name in {row.method for row in study.rows}:
        figure, ((axis,),) = new_figure(1, size=(3.6, 2.6))
        for row in study.rows:
            own = row.method == name
            style = {"color": COLOURS[0], "markersize": 6, "zorder": 3} if own else {"color": "0.8", "markersize": 3}
            axis.loglog(row.seconds, row.error, "o", **style)
        axis.set(xlabel="seconds", ylabel="error (rad)")
        save_figure(figure, folder / f"{name}.png")
    log.info("%d rows of the study of methods", len(study.rows))


def picture(app: Any, name: str) -> str:
    """The picture of a method for a generated page; "" where there is none."""
    if not (Path(app.outdir) / FOLDER / f"{name}.png").exists():
        return ""
    return f'<img class="cost" src="../{FOLDER}/{name}.png" alt="Error over seconds by {name}" loading="lazy">'


def setup(app: Any) -> dict[str, bool]:
    """Register the study."""
    app.connect("builder-inited", write_pictures, priority=450)  # the catalogue, made then too, shows the pictures
    return {"parallel_read_safe": True, "parallel_write_safe": True}
