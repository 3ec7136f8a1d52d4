"""Bodies that touch: pairs of links, or a ball and a plane, with friction and restitution."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar, Literal

import pinocchio as pin

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Scalar, Vec, add, minus, plus, scale, times
from twolink.dynamics import Robot
from twolink.effects.contact_pairs import Body, Pairs, hollow_notes, select_pairs, solids_of
from twolink.effects.effect import Effect, NotNegative, Share
from twolink.effects.inputs import Slot
from twolink.effects.loops import Loop
from twolink.effects.switching import ContactPair, ContactPoint, SwitchingEffect
from twolink.errors import SceneError
from twolink.geometry.fields import HeightField
from twolink.geometry.gaps import Gap
from twolink.geometry.pairs import Pair, are_hulls, features_of, gaps_of
from twolink.robots.collisions import AnyShape

STILL = 1e-11  # m/s: a slip whose direction is rounding


def contact_point(
    name: str, gap: Gap, friction: float, restitution: float, static: float | None = None, *, reflects: bool = False,
    threshold: float = 0.0,
) -> ContactPoint:  # fmt: skip
    """A contact of the engine from a gap and the numbers of its law."""
    constraint, content = functools.partial(Touching, name, gap, friction), repr((gap, friction, restitution))
    return ContactPoint(name, restitution, friction, friction if static is None else static, gap.value, gap.velocity,
                        constraint, content, gap.single, reflects, threshold)  # fmt: skip


class Touching(Loop, frozen=True):
    """g = 0, and while it rolls or sticks c = 0 along both tangents; while it slides, with friction.

    pair: the name of the two bodies. friction: mu. rolling: whether it rolls or sticks. before: along the direction of
    sliding when that began, the speed of a slip whose direction is not followed, along the two tangents, m/s: c does
    not change to the other side of it before an event.
    """

    pair: str
    gap: Gap
    friction: float
    rolling: bool
    before: tuple[Slot, Slot] | tuple[float, float]

    touches: ClassVar[bool] = True
    max_rows: ClassVar[int] = 3  # the normal row, and two along the tangents

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """The gap, of what touches."""
        return [motion.once(self.gap.nearest).gap]

    def velocity_rows(self, motion: KinematicState) -> list[Scalar]:
        """c along the tangents."""
        return list(self.gap.velocity(motion)[1:]) if self.rolling else []

    def forces(self, motion: KinematicState, along: KinematicState) -> list[Scalar] | None:
        """The power of a normal force of size 1 and of its friction."""
        if self.rolling or not self.friction:
            return None
        normal, *others = self.gap.velocity(along)
        friction = plus(*(times(d, other) for d, other in zip(self.sliding(motion), others, strict=True)))
        return [minus(normal, times(self.friction, friction))]

    def contact_force(self, motion: KinematicState, multipliers: Sequence[Scalar]) -> tuple[str, Vec, Vec]:
        """The normal force and that of friction, at the nearest point of the first body."""
        normal, *across = multipliers
        if not self.rolling:
            directions = self.sliding(motion) if self.friction else (0.0, 0.0)
            across = [times(-self.friction, times(normal, d)) for d in directions]
        near = motion.once(self.gap.nearest)
        force = add(*(scale(size, axis) for size, axis in zip((normal, *across), near.axes, strict=True)))
        return self.pair, near.first.position(motion), force

    def contact_slip(self, motion: KinematicState) -> Vec:
        """c along the world's axes."""
        slip, axes = self.gap.velocity(motion)[1:], motion.once(self.gap.nearest).axes[1:]
        return add(*(scale(speed, axis) for speed, axis in zip(slip, axes, strict=True)))

    def sliding(self, motion: KinematicState) -> list[Scalar]:
        """The direction of sliding along the two tangents: of c + b s / sqrt(s^2 + |c|^2), with b = `before`, s = |b|.

        That of c alone is singular at c = 0, and need not be b there: steps would be ever smaller. This one is singular
        past the plane c . b = 0, which ends the mode. What it adds to c vanishes as c grows.
        """
        xp = motion.xp
        _, x, y = self.gap.velocity(motion)
        a, b = self.before
        slip, slow = plus(times(x, x), times(y, y)), plus(times(a, a), times(b, b))
        moves = xp.where(xp.less(slip, STILL * STILL), 0.0, 1.0)
        weight = xp.sqrt(slow / plus(slow, slip))
        x, y = plus(times(moves, x), times(weight, a)), plus(times(moves, y), times(weight, b))
        speed = xp.sqrt(plus(times(x, x), times(y, y)))
        speed = xp.where(xp.less(speed, STILL), STILL, speed)
        # Beyond, where steps look too, the direction stays, so that it has no corner.
        sign = xp.where(xp.less(plus(times(x, a), times(y, b)), 0.0), -1.0, 1.0)
        return [times(sign, now / speed) for now in (x, y)]


SHOWN = 8  # names of pairs in a line


class Contact(SwitchingEffect, frozen=True):
    """Bodies that touch, at the points where their shapes meet, with Coulomb's friction and Newton's restitution.

        0 <= g,  0 <= N,  g N = 0     bodies do not overlap and do not pull (Signorini 1933)
        |T| <= mu N                   friction; T = mu N against the slip while the bodies slide (Coulomb 1785)
        g'+ = -e g'-                  at an impact (Newton 1687)

    Where several contacts are hit at once, or bodies that touch are hit:

        "newton"       one impulse: each contact that presses obeys Newton's law, g'+ = -e g'-, and the others part.
                       What only touches has g'- = 0 and stays, or parts. (Moreau 1988)
        "reflections"  rounds of it: in each round only those that approach, g' < 0, until none does. Blows travel
                       through bodies that touch, as through Newton's cradle; with e = 1 the energy is kept.
                       (Smith, Kaufman, Vouga, Tamstorf, Grinspun: Reflections on simultaneous impact, 2012)

    Both agree for one contact. Rigid bodies do not decide between them: "newton" suits bodies of which the blow
    reaches all at once, "reflections" stiff bodies that pass it on one after the other. Stepped contacts obey "newton".

    Parameters
    ----------
    pairs : str, or tuple of str or pair
        Which bodies may touch: pairs of names of links or of collision shapes, "ground", a `Plane` or a `HeightField`,
        such as ("foot", "ground"). Alone, "ground" means every link against the ground z = 0, and "self" the robot's
        links against each other, without those that a joint connects, that overlap in the neutral configuration, or
        that an SRDF beside the URDF disables, which `explain` lists; bodies that only a free joint connects count as
        separate.
    friction : float
        mu of sliding bodies, not negative.
    restitution : float
        e, from 0 to 1.
    static : float, optional
        mu of bodies that do not slide, not below the friction, which it is by default.
    impacts : {"newton", "reflections"}
        The law of several contacts at once, see above.
    shapes : mapping of link to shapes
        In place of the URDF's <collision> elements of these links: `Sphere`, `Box`, `Cylinder`, `Capsule`, `Convex`.
    margin : float
        Pairs of "self" that are nearer than this in the neutral configuration are left out too, m.
    exclude : tuple of pair
        Pairs that do not touch: of all those of `pairs` but these.
    threshold : float
        Bodies that approach more slowly do not bounce, m/s: e = 0 for g'- >= -threshold.
    concavity : float, optional
        Meshes of the URDF whose surfaces lie farther than this below their convex hulls, m, are cut into convex parts
        that are less concave each; by default they count as their hulls. Needs twolink[decomposition].

    Notes
    -----
    Where bodies rest on more points than determine their forces, only the sums of the forces of a pair are determined.
    Bodies that slide and turn at once on such points, at an impact too, move as the points share the load: located,
    they are refused with code "indeterminate-forces".
    Located, boxes and convex meshes touch each other with corners on faces and with edges that cross; where a corner
    passes an edge, what touches beside it takes over (event "edge"). Refused with code "no-single-point": what touches
    along a line or has several normals (a cylinder that falls on its end or tips over its rim, parallel capsules or
    edges, a corner that hits an edge or a corner). With "no-located-contact": cylinders against other than planes and
    spheres, and meshes of many faces.
    """

    touches: ClassVar[bool] = True

    pairs: str | tuple[str | tuple[Body, Body], ...] = ("self", "ground")
    friction: NotNegative = 0.0
    restitution: Share = 0.0
    static: NotNegative | None = None
    impacts: Literal["newton", "reflections"] = "newton"
    shapes: Mapping[str, tuple[AnyShape, ...]] = {}
    margin: NotNegative = 0.0
    exclude: tuple[tuple[Body, Body], ...] = ()
    threshold: NotNegative = 0.0
    concavity: NotNegative | None = None

    def check(self, robot: Robot) -> None:
        """Names exist, and at least one pair may touch."""
        if self.static is not None and self.static < self.friction:
            raise SceneError(f"it is {self.static:g}, below the friction {self.friction:g}", where="static",
                             remedy="static friction is the larger one")  # fmt: skip
        if self.static and not self.friction:
            raise SceneError(f"it is {self.static:g}, and the friction 0", where="static",
                             remedy="give a friction above 0, such as 1e-9")  # fmt: skip
        if self.concavity is not None and not self.concavity > 0.0:
            raise SceneError(f"it is {self.concavity:g} m", where="concavity",
                             remedy="give a length above 0, or leave it out for the hulls")  # fmt: skip
        self.selected(robot)

    def check_beside(self, effects: Sequence[Effect], robot: Robot) -> None:
        """No pair has two laws."""
        others = (one for one in effects if isinstance(one, Contact))
        before = list(itertools.takewhile(lambda one: one is not self, others))
        if not before:
            return
        known = {frozenset(pair[1:]) for one in before for pair in one.selected(robot).chosen}
        twice = next((pair.name for pair in self.selected(robot).chosen if frozenset(pair[1:]) in known), None)
        if twice is not None:
            raise SceneError(f"another Contact has {twice} too", where="pairs", code="pair-twice",
                             remedy="exclude=((FIRST, SECOND),) there")  # fmt: skip

    def pieces(self) -> list[pin.GeometryObject]:
        """The height fields that bodies may touch."""
        every = (body for pair in self.pairs for body in (() if isinstance(pair, str) else pair))
        return [field.piece() for field in dict.fromkeys(body for body in every if isinstance(body, HeightField))]

    def selected(self, robot: Robot) -> Pairs:
        """The pairs that may touch, and those of "self" that may not."""
        asked = (self.pairs,) if isinstance(self.pairs, str) else self.pairs
        concavity = None if self.concavity is None else float(self.concavity)
        solids = solids_of(robot, self.shapes, concavity)
        return select_pairs(robot, solids, asked, float(self.margin), self.exclude)

    def notes(self, robot: Robot) -> list[str]:
        """Notes on the pairs: the number watched, those of "self" that are not, and what the hulls of meshes fill."""
        pairs = self.selected(robot)
        lines = [f"{_pairs(len(pairs.chosen))} may touch: {_listed(dict.fromkeys(pair.name for pair in pairs.chosen))}"]
        for reason in sorted({reason for _, reason in pairs.excluded}):
            names = [name for name, why in pairs.excluded if why == reason]
            lines.append(f"{_pairs(len(names))} left out ({reason}): {_listed(names)}")
        return [*lines, *hollow_notes(pairs)]

    def modes(self, robot: Robot) -> list[ContactPoint | ContactPair]:
        """A gap for each point at which a pair may touch; of boxes and convex meshes, the pair with its features."""
        return [item for pair in self.selected(robot).chosen for item in self._modes_of(pair)]

    def _modes_of(self, pair: Pair) -> Sequence[ContactPoint | ContactPair]:
        point = functools.partial(contact_point, pair.name, friction=float(self.friction),
                                  restitution=float(self.restitution), reflects=self.impacts == "reflections",
                                  threshold=float(self.threshold),
                                  static=None if self.static is None else float(self.static))  # fmt: skip
        if not are_hulls(pair):
            return [point(gap) for gap in gaps_of(pair)]
        features = features_of(pair)
        content = repr((pair, self.friction, self.static))
        return [ContactPair(pair.name, features.gaps, features.touching, features.separation, point, content)]


def _pairs(count: int) -> str:
    return f"{count} pair{'s' * (count > 1)}"


def _listed(all_names: Iterable[str]) -> str:
    """The first names of a list."""
    names = list(all_names)
    return ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
