"""The tasks of worker processes by name: what `Workers.run` may ask for."""

from twolink.service.robot_tasks import draw, load, receive
from twolink.service.scene_tasks import explain, export, motion, simulate, study, validate

TASKS = {task.__name__: task for task in (receive, load, draw, validate, explain, simulate, study, export, motion)}
