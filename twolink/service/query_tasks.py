"""The task of the computing worker processes: a query too large for the event loop, with body and answer in a file."""

from typing import BinaryIO

import msgspec
import numpy as np

from twolink.service import npz
from twolink.service.http_io import JSON
from twolink.service.query_answers import (
    answer_query,
    arguments_from_json,
    arguments_from_npz,
    count_of,
    require_size,
)
from twolink.service.robot_tasks import load, robot_by_id
from twolink.service.settings import Quotas


def query(*, key: str, what: str, sent: str, reply: str, robots: str, quotas: Quotas, exchange: BinaryIO) -> int:
    """Answer the query in the file `exchange` by what is written into it, and return the number of states.

    sent, reply: the media types of the body and of the answer. robots: the folder of uploaded robots.
    """
    robot = robot_by_id(key, robots)
    if sent == JSON:
        arguments = arguments_from_json(what, exchange.read())
    else:
        arguments = arguments_from_npz(what, npz.read_npz(exchange, int(quotas.upload_mb * 2**20)))
    count, numbers = count_of(robot, what, arguments)
    require_size(count, numbers, quotas, reply == JSON)
    result = answer_query(robot, what, arguments)
    exchange.seek(0)
    exchange.truncate()
    if reply == JSON:
        exchange.write(msgspec.json.encode(result, enc_hook=np.ndarray.tolist))
    else:
        npz.save_npz(exchange, {name: np.asarray(value) for name, value in result.items()})
    return count


TASKS = {task.__name__: task for task in (load, query)}
