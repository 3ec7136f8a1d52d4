"""The choice of the contact method: located one by one, or stepped through.

Located contacts are verified. Each mode that they pass takes programs of its own: the first run of one box takes 1 s,
of 24 points 4 s, of 32 points 7 s, and later runs a tenth to a third of that. Stepping takes microseconds a step and
goes through any number of contacts; its error can only be estimated.
"""

import math
from typing import Literal, NamedTuple

from twolink.effects.switching import SwitchingEffect
from twolink.errors import SceneError, require_known
from twolink.scenes import Scene

ContactMethod = Literal["located", "stepped"]
METHODS = ("located", "stepped")
POINTS = 24  # at which bodies may touch: beyond, a located run is prepared for longer than its bar is worth


class Choice(NamedTuple):
    """The method, and the reason. The method is None where no body touches and stepping is not asked for."""

    method: ContactMethod | None
    why: str = ""


def choose_contact_method(scene: Scene, asked: str | None = None) -> Choice:
    """The choice of a scene's contact method. asked: "located" or "stepped" forces it. Raises SceneError."""
    touching = any(effect.touches for effect in scene.effects)
    if asked is None:
        return _by_shapes(scene) if touching else Choice(None)
    require_known(asked, METHODS, SceneError, argument="contact")
    if asked == "located":
        return Choice("located", "asked for") if touching else Choice(None)
    if not any(isinstance(effect, SwitchingEffect) for effect in scene.effects):
        raise SceneError("the scene has no contact, stops or dry friction to step through", argument="contact",
                         remedy="leave it out, or add tl.effects.Contact(...)")  # fmt: skip
    return Choice("stepped", "asked for")


def can_be_located(scene: Scene) -> bool:
    """True if every pair of shapes has a formula, however many points touch."""
    return _by_shapes(scene, math.inf).method == "located"


def _by_shapes(scene: Scene, most: float = POINTS) -> Choice:
    """Located where every pair has formulas, and not too many.

    By shapes alone: the impacts of a first part in coarse steps do not foretell the events of the run, and preparing a
    located run costs more than its events do.
    """
    from twolink.effects.contact import Contact  # which scenes without contacts do not load
    from twolink.geometry.pairs import points_of

    points, contacts = 0, [effect for effect in scene.effects if isinstance(effect, Contact)]
    for pair in (pair for effect in contacts for pair in effect.selected(scene.robot).chosen):
        try:
            points += points_of(pair)
        except SceneError as error:
            return Choice("stepped", error.what)
        if points > most:
            return Choice("stepped", f"bodies may touch at more than {most} points, which takes longer to locate")
    return Choice("located", f"bodies may touch at {points} points, each by a formula; up to {POINTS} are located")
