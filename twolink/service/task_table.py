"""The tasks of worker processes by name: what `Workers.run` may ask for."""

from twolink.service.answer_tasks import identify, linearize, quantities, sense
from twolink.service.job_requests import prepare
from twolink.service.robot_tasks import draw, load, receive
from twolink.service.scene_tasks import explain, export, motion, simulate, study, validate
from twolink.service.sweep_tasks import export_sweep, pack_robot, sweep, sweep_columns, sweep_run

_ABOUT_ROBOTS = (receive, load, draw)
_ABOUT_SCENES = (validate, explain, quantities, linearize)
_JOBS = (prepare, pack_robot, simulate, study, sense, identify, sweep)
_RESULTS = (export, motion, export_sweep, sweep_columns, sweep_run)
TASKS = {task.__name__: task for task in (*_ABOUT_ROBOTS, *_ABOUT_SCENES, *_JOBS, *_RESULTS)}
