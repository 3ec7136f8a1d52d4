"""What steps a scene: its smooth effects as equations, its contacts, stops, dry friction and loops as impulses."""

import weakref

from twolink.contact.loops import LoopRows
from twolink.contact.stepping import Stepper
from twolink.effects.contact import Contact
from twolink.effects.loops import Loop
from twolink.effects.switching import Hold, Stop, SwitchingEffect
from twolink.errors import SceneError
from twolink.integrate.scene_equations import equations_of
from twolink.scenes import Scene

OVERLAP = 1e-9  # m, at the start
_smooth: weakref.WeakKeyDictionary[Scene, tuple[Scene, Scene]] = weakref.WeakKeyDictionary()


def stepper_of(scene: Scene) -> Stepper:
    """What steps a scene. Raises SceneError for what cannot be stepped."""
    effects = [effect for effect in scene.effects if isinstance(effect, Contact)]
    if any(effect.impacts == "reflections" for effect in effects):
        raise SceneError('Contact with impacts="reflections" is not stepped: expected "newton", one impulse a step',
                         where="impacts", remedy='contact="located", or impacts="newton"',
                         code="not-stepped")  # fmt: skip
    others = [effect for effect in scene.effects if not isinstance(effect, Contact)]
    declared = [item for e in others if isinstance(e, SwitchingEffect) for item in e.modes(scene.robot)]
    stops = [item for item in declared if isinstance(item, Stop)]
    holds = [item for item in declared if isinstance(item, Hold) and item.entry is None]
    if len(stops) + len(holds) < len(declared):
        raise SceneError("effects that switch, other than joint stops and dry friction, cannot be stepped",
                         argument="contact", remedy='contact="located", or leave them out',
                         code="not-stepped")  # fmt: skip
    if scene not in _smooth:  # the same scene has the same equations, which are kept as long as it is
        smooth = [effect for effect in others if not isinstance(effect, SwitchingEffect)]
        looped = Scene(scene.base, scene.q, scene.v, smooth, scene.duration, scene.title)
        free = [effect for effect in smooth if not isinstance(effect, Loop)]
        q, v = equations_of(looped).space.rows(equations_of(looped).start)
        _smooth[scene] = looped, Scene(scene.base, q, v, free, scene.duration, scene.title)
    with_loops, equations = (equations_of(one) for one in _smooth[scene])
    loops = None if with_loops.constraints is None else LoopRows(with_loops, with_loops.constraints)
    stepper = Stepper(equations, effects, stops, holds, loops)
    overlap, pair = stepper.overlap(equations.start[: equations.space.nq])
    if overlap > OVERLAP:
        raise SceneError(f"{pair} overlap by {overlap:.3g} m at the start", where="q", code="overlap",
                         remedy="start with bodies apart, and joints within their stops")  # fmt: skip
    return stepper
