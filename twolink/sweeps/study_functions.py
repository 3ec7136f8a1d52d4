"""What the bundled studies keep of a run."""

import math

from twolink.simulation.trajectory import Trajectory


def landing(run: Trajectory) -> float:
    """Where the ball of a pitch lands, m; NaN where it does not."""
    if not any(event.what == "landed" for event in run.events):
        return math.nan
    return float(run.robot.frame_pose(run.robot.normalize(run.q[-1]), "ball")[1][0])
