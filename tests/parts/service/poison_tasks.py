"""The tasks of workers, where the run with one start value ends its process; for tests of sweeps."""

import ctypes
import functools
from typing import Any

from twolink.parts.service.work import sweep_tasks, task_table
from twolink.parts.sweeps import engines
from twolink.parts.sweeps.runs import SweepTask, compute

POISON = 0.5


def crash(task: SweepTask) -> Any:
    if POISON in task.values["q.elbow"]:
        ctypes.string_at(0)
    return compute(task)


@functools.wraps(sweep_tasks.sweep)
def sweep(**arguments: Any) -> Any:
    engines.compute = crash
    return sweep_tasks.sweep(**arguments)


TASKS = {**task_table.TASKS, "sweep": sweep}
