"""The height of bounces that are followed no more: their rest is summed in closed form, and is part of the bar."""

from dataclasses import dataclass

from twolink.integrate.steps.methods import Method

SMALL_BOUNCE = 1e-2  # of the tolerance: lower bounces are not followed
OF_FIXED_STEPS = 1e-10  # m or rad, in place of a tolerance: each bounce takes some steps
EARLIER = 4.0  # times as high, at least: bounces whose end shows what lower ones leave out
LEAST_RESTITUTION = 0.1  # smaller ones count as this


@dataclass(frozen=True)
class LeastBounce:
    """The height of bounces that are not followed, m or rad.

    Parameters
    ----------
    height : float
        Of the run.
    finer : float
        How many times as fine a solution is that shows what these leave out of the run. It follows lower ones; where
        numbers do not resolve them, it ends at a higher one, which leaves out a few times as much.
    """

    height: float
    finer: float = 1.0

    @classmethod
    def of_run(cls, method: Method, setting: float, finer: float = 1.0) -> "LeastBounce":
        """The least bounce of a method with its tolerance or its step."""
        return cls(SMALL_BOUNCE * (setting if method.adaptive else OF_FIXED_STEPS), finer)

    def of(self, restitution: float, seen: float) -> float:
        """The height with a restitution. seen: what numbers resolve, to which a bounce without a loss is followed."""
        height, ratio = self.height if restitution < 1.0 else 0.0, 1.0
        if self.finer > 1.0:
            ratio = max(EARLIER, 1.5 / max(restitution, LEAST_RESTITUTION) ** 2)
            lower = height / max(self.finer, ratio)
            if lower >= seen:
                return lower
        return ratio * max(height, seen)


EVERY_BOUNCE = LeastBounce(0.0)  # that numbers resolve
