"""The tasks of `escape_tasks` for a worker that may use the network."""

from tests.parts.service.escape_tasks import TASKS as TASKS

NETWORK = True
