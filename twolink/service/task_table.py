"""The tasks of worker processes by name: what `Workers.run` may ask for."""

from twolink.service.answer_tasks import identify, linearize, sense
from twolink.service.job_requests import prepare
from twolink.service.robot_tasks import draw, load, receive
from twolink.service.scene_tasks import explain, export, motion, simulate, study, validate

_ALL = (receive, load, draw, validate, explain, linearize, prepare, simulate, study, sense, identify, export, motion)
TASKS = {task.__name__: task for task in _ALL}
