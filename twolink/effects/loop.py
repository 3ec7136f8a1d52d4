"""Loops: constraints g(q) = 0 or b(q) v = 0 between places of a robot, besides its joints."""

from collections.abc import Sequence
from typing import ClassVar

from twolink.algorithms.spatial import Scalar, Vec
from twolink.effects.effect import Effect
from twolink.effects.motion import Motion


class Loop(Effect, frozen=True):
    """A rigid bilateral constraint, held by the force J^T lambda that it takes.

    Redundant rows are recognized and dropped, so that a planar loop may be given as the whole joint.
    """

    touches: ClassVar[bool] = False  # whether it is that of bodies that touch
    max_rows: ClassVar[int] = 0  # the number of rows in the mode that has most; 0 where it has no modes

    def carrier(self, motion: Motion) -> int:
        """The body along whose axes the rows are, where they are differences of points; 0 is the ground.

        Seen from the nearest body that carries both places, the rows do not depend on the joints that carry it: a loop
        that hangs on a long chain costs what it costs alone.
        """
        del motion
        return 0

    def rows(self, motion: Motion) -> list[Scalar]:
        """g(q), m and (of directions) 1: what stays 0."""
        raise NotImplementedError

    def velocity_rows(self, motion: Motion) -> list[Scalar]:
        """b(q) v, m/s: what stays 0 of velocities alone, as rolling does. Linear in v."""
        del motion
        return []

    def forces(self, motion: Motion, along: Motion) -> list[Scalar] | None:
        """The power along another velocity of each row's force of size 1, where that force is not the row's J^T.

        motion: q and v. along: the same q and some other velocity. Friction is such a force: it comes with the normal
        one, and does not act along it.
        """
        del motion, along
        return None

    def contact_force(self, motion: Motion, multipliers: Sequence[Scalar]) -> tuple[str, Vec, Vec] | None:
        """The pair of bodies whose contact this is, the point where it acts, m, and the force on the first, N.

        Both are along the world's axes.
        """
        del motion, multipliers
        return None
