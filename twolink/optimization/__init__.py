"""Optimization: numbers of a scene chosen so that a function of its run is least or greatest.

In: a scene, bounds of some of its numbers by name, an objective and constraints as functions of a run. Out: an
`Optimum`: the best scene, its run, the history, and how far each can be trusted; or the `Gradient` of the objective
alone. This room knows no scene by name, no command line and no service.
"""

from twolink.optimization.gradient import Gradient, gradient
from twolink.optimization.optimize import Optimum, optimize

__all__ = ["Gradient", "Optimum", "gradient", "optimize"]
