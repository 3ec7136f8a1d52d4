"""The choice of the contact method: located one by one, or stepped through.

Located contacts are verified, and their cost grows with every event. Stepping goes through any number of contacts, and
its error can only be estimated.
"""

from typing import Literal, NamedTuple

from twolink.errors import SceneError, require_known
from twolink.scenes import Scene

ContactMethod = Literal["located", "stepped"]
METHODS = ("located", "stepped")
MANY = 200  # points of contacts beyond which they are stepped: each is a formula in every guard of a located run
# Pairs of hulls that are located; `scripts.studies.contacts --both` solves scenes of one faster located than stepped.
HULLS = 1


class Choice(NamedTuple):
    """The method, and the reason; the method is None for a scene without contacts."""

    method: ContactMethod | None
    why: str = ""


def choose_contact_method(scene: Scene, asked: str | None = None) -> Choice:
    """The choice of a scene's contact method. asked: "located" or "stepped" forces it. Raises SceneError."""
    effects = [effect for effect in scene.effects if effect.touches]
    if asked is not None:
        require_known(asked, METHODS, SceneError, argument="contact")
        if asked == "stepped" and not effects:
            raise SceneError("the scene has no Contact effect", argument="contact",
                             remedy="add tl.effects.Contact(...)")  # fmt: skip
        return Choice("stepped" if asked == "stepped" else "located", "asked for") if effects else Choice(None)
    return _by_shapes(scene) if effects else Choice(None)


def _by_shapes(scene: Scene) -> Choice:
    """Located where every pair has formulas, and not too many.

    By shapes alone: the impacts of a first part in coarse steps do not foretell the events of the run, and compiling
    costs more than events do.
    """
    from twolink.effects.contact import Contact  # which scenes without contacts do not load
    from twolink.geometry.pairs import are_hulls, features_of, gaps_of

    points, hulls = 0, 0
    for effect in scene.effects:
        if not isinstance(effect, Contact):
            continue
        for pair in effect.selected(scene.robot).chosen:
            try:
                if are_hulls(pair):
                    features_of(pair)
                    hulls += 1
                else:
                    points += len(gaps_of(pair))
            except SceneError as error:
                return Choice("stepped", error.what)
            if hulls > HULLS:
                why = f"more pairs than {HULLS}, such as {pair.name}, touch at corners and edges that change"
                return Choice("stepped", f"{why}: stepping costs less")
            if points > MANY:
                return Choice("stepped", f"bodies may touch at more than {MANY} points")
    where = [f"{points} points, each by a formula"] * (points > 0 or not hulls)
    return Choice("located", f"bodies may touch at {' and '.join([*where, *['corners and edges of a pair'] * hulls])}")
