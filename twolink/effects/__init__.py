"""Effects: what a scene calls for. One file an effect, each with its equation and source."""

from twolink.effects.effect import Effect
from twolink.effects.gravity import Gravity

__all__ = ["Effect", "Gravity"]
