"""The tasks of worker processes, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from twolink.service import robot_tasks
from twolink.service import scene_tasks as experiment_tasks

TASKS: dict[str, Callable[..., Any]] = {
    "receive": robot_tasks.receive,
    "load": robot_tasks.load,
    "draw": robot_tasks.draw,
    "validate": experiment_tasks.validate,
    "explain": experiment_tasks.explain,
    "simulate": experiment_tasks.simulate,
    "study": experiment_tasks.study,
    "export": experiment_tasks.export,
    "motion": experiment_tasks.motion,
}
