"""Simulation: a scene becomes a trajectory with an error bar and a price.

In: a scene, a duration and an accuracy. Out: a `Trajectory` (one world) or `Worlds` (many), each verified by a second
solution; the energy balance of a run; an explanation of what a run will take. This room knows no command line and no
service.
"""

from twolink.integrate.solution import Event
from twolink.simulation.certificate import Certificate
from twolink.simulation.cost import Cost
from twolink.simulation.explanation import Explanation, explain
from twolink.simulation.many_runs import Worlds
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.worlds import simulate_many

__all__ = [
    "Certificate",
    "Cost",
    "Event",
    "Explanation",
    "Trajectory",
    "Worlds",
    "explain",
    "simulate",
    "simulate_many",
]
