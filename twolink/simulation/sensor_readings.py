"""Sensors read along a solution that was computed without them."""

from __future__ import annotations

import functools
import itertools
from typing import TYPE_CHECKING

import numpy as np

from twolink.effects.sampled_control import exact
from twolink.effects.sensors import Forces, Seen, Sensor
from twolink.errors import SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.motion.equations import Equations
from twolink.loop.clock import Random, Readings, reading
from twolink.scenes import Scene

if TYPE_CHECKING:
    from twolink.contact.spliced import Solved


def readings_of(scene: Scene | None, solution: Solved) -> dict[str, Readings]:
    """The readings of a scene's sensors by name: those of the run, else read afterwards."""
    kept = solution.segments[0].readings or {}
    sensors = {} if scene is None else scene.sensors
    return kept | {name: _read_along(sensor, solution) for name, sensor in sensors.items() if name not in kept}


def _read_along(sensor: Sensor, solution: Solved) -> Readings:
    """The readings of a sensor. Raises SceneError where it needs forces of stepped contacts."""
    end, period, offset = float(solution.t[-1]), exact(sensor.period), exact(sensor.offset)
    ticks = (float(offset + k * period) for k in itertools.count())
    times = np.array(list(itertools.takewhile(lambda t: t <= end, ticks)))
    if not len(times):
        return Readings(times, np.empty((0, 0)))
    states, values = solution.states(times), dict[int, np.ndarray]()

    def look(equations: Equations, places: np.ndarray, numbers: np.ndarray) -> Forces:
        if not isinstance(solution, DenseOutput):
            raise SceneError("the forces of stepped contacts are means over steps: no sensor reads them",
                             where=sensor.label, remedy="take run.tau or run.contact_forces")  # fmt: skip
        return forces_seen(equations, times[places], np.append(states[:, places], numbers, axis=0))

    whole = [(solution.segments[0].equations, np.arange(len(times)), states[:0])]
    for equations, places, numbers in solution.by_segment(times) if isinstance(solution, DenseOutput) else whole:
        q, v = equations.space.rows(states[:, places])
        z = dict(zip(equations.space.states, states[equations.space.z_rows, places], strict=True))
        seen = Seen(equations.robot, q, v, z, functools.partial(look, equations, places, numbers))
        values |= dict(zip(places.tolist(), sensor.read(seen), strict=True))
    random = Random(sensor.seed, sensor.label, len(values[0]))
    return Readings(times, np.array([reading(sensor, random, k, values[k][None])[0] for k in range(len(times))]))
