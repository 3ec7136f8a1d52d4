"""The forces that sensors feel."""

from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Numbers
from twolink.effects.plane_contact import CompliantContact
from twolink.effects.sensors import Forces
from twolink.integrate.joint_forces import accelerations_and_joint_torques, contacts, wrenches_on_links
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import loaded
from twolink.integrate.motion.state import Array
from twolink.io.text import kebab_case


def forces_seen(equations: Equations, t: float | Array, x: Array) -> Forces:
    """Forces that sensors feel at states x (nq + nv or size, n) of one piece at a time, or at times (n,)."""
    count = x.shape[1]
    states = equations.full(x)
    times = np.broadcast_to(t, count)
    a, tau = accelerations_and_joint_torques(equations, times, states)
    motion, loads = loaded(equations, equations.mechanism, times, states, Numbers)
    felt = np.zeros((count, equations.robot.model.njoints, 6))
    for body, wrench in loads.wrenches.items():
        felt[:, body] = np.array([np.broadcast_to(part, count) for part in wrench]).T

    def on(link: str) -> Array:
        total, touching = np.zeros((count, 3)), equations.constraints.touching if equations.constraints else []
        loops: list[Any] = list(equations.layout.with_numbers(touching, list(states[equations.moving :])))
        for loop, (_, _, force) in zip(loops, contacts(equations, times, states), strict=True):
            nearest = loop.gap.nearest(motion)
            total += (int(nearest.first.frame == link) - int(nearest.second.frame == link)) * force.T
        pressed = f"{kebab_case(CompliantContact.__name__)} on {link}"
        return total + sum(force.T for name, _, force, _ in wrenches_on_links(equations, times, x) if name == pressed)

    return Forces([equations.robot] * count, a.T, tau.T, [[pin.Force(one) for one in row] for row in felt], on)
