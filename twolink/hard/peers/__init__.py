"""Peers: other simulators that solve the same scene, for the hard cases and for scripts/benchmarks/peers.py.

A PeerTask goes in: a robot, an initial state, times, and those effects that peers have as well. States at the times
come out. Every peer is a module with the same functions, and takes its model from the numbers of the pin.Model:

- `SIMULATES`: what of a task it simulates; all else is refused by `prepare`, by name. `SOFTENS`: which of that it
  replaces by laws of its own, so that its answer is of another problem.
- `usual_settings(task)`: the peer's own default setting and a tight one.
- `all_settings(task, coarse)`: settings from rough to fine, method by method.
- `prepare(task, setting)`: builds the model, and returns the function that solves; calling it is what is timed.
- `accelerations(task)`: the peer's forward dynamics without torques, for the comparison with pin.aba.

Nothing here judges an answer.
"""

import importlib
from types import ModuleType

NAMES = {"scipy": "SciPy", "mujoco": "MuJoCo", "drake": "Drake"}


def peer_module(name: str) -> ModuleType:
    """The module of a peer. Raises ImportError where the peer is not installed."""
    return importlib.import_module(f"twolink.hard.peers.{name}_peer")
