"""MuJoCo's model and state of a scene, for loops of single steps."""

from typing import Any

import mujoco
import numpy as np

import twolink as tl
from twolink.hard.peers import mujoco_peer
from twolink.hard.peers.task import from_peer, task_of, to_peer


class MujocoWorld:
    """A scene at its start. `data` is MuJoCo's own; q_at and v_at are the entries of its q and v in our order."""

    def __init__(self, scene: tl.Scene, step: float, integrator: str = "Euler") -> None:
        self.task = task_of(scene, np.array([0.0, step]))
        self.model = mujoco_peer.build(self.task)
        self.model.opt.timestep = step
        self.model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        self.data: Any = mujoco.MjData(self.model)
        self.q_at, self.v_at = mujoco_peer.columns(self.task, self.model)
        self.start = to_peer(self.task, body_spin=True)
        self.begin()

    def begin(self) -> None:
        """Go back to the start."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.q_at], self.data.qvel[self.v_at] = self.start

    def ours(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Our q (n, nq) of rows of MuJoCo's q and v."""
        return from_peer(self.task, q[:, self.q_at], v[:, self.v_at], body_spin=True).q
