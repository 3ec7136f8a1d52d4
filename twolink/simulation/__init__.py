"""Ensembles: many worlds of one scene at once, in one compiled batch."""

from twolink.simulation.worlds import Worlds, simulate_many

__all__ = ["Worlds", "simulate_many"]
