"""Functions of the package that are called with what a request has, for their whole answer."""

import inspect
from collections.abc import Callable
from typing import Any

import msgspec

import twolink as tl
from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.errors import SceneError
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.data_folder import UPLOADED
from twolink.parts.service.work.bodies import NOT_SENT, arguments_of, sent_as
from twolink.parts.service.work.requests import JOB_KINDS
from twolink.parts.service.work.robot_tasks import robot_by_id
from twolink.parts.service.work.scene_tasks import require_allowed, scene_of, told
from twolink.parts.service.work.worker import Report
from twolink.scenes import Scene
from twolink.scenes.urdf_scene import is_robot
from twolink.scenes.urdf_scene import scene_of as scene_of_robot
from twolink.simulation.text import as_data


def answer_of_call(
    request: Any, scene_from: Callable[[Any], Scene], robot_from: Callable[[str], Robot], **own: Any
) -> dict[str, Any]:
    """The result of the function that a request names, as plain data, with a title and its text for people.

    request: one of the requests for an operation. own: what the caller decides, where the function takes it.
    """
    function = getattr(tl, request.__struct_config__.tag)
    given = arguments_of(request)
    scenes, robots = sent_as(function, Scene), sent_as(function, Robot)
    for name in {*scenes, *robots}:  # which may be the same: a robot stays one, as the function means it otherwise
        asked = given[name]
        named = isinstance(asked, str) and bool(is_robot(asked) or UPLOADED.fullmatch(asked))
        given[name] = (robot_from if name in robots and (named or name not in scenes) else scene_from)(asked)
    titles = [one.title or one.robot.name if isinstance(one, Scene) else one.name
              for one in given.values() if isinstance(one, Scene | Robot)]  # fmt: skip
    taken = inspect.signature(function).parameters
    found = function(**given, **{name: own[name] for name in NOT_SENT if name in taken and name in own})
    record = msgspec.to_builtins(found) if isinstance(found, Effect) else as_data(found)
    return {"title": ", ".join(titles), "text": str(found), **record}


def operate(*, body: bytes, robots: str, quotas: Quotas, report: Report) -> dict[str, Any]:
    """Call the function that a request names, and return the record of its result, which is all of it.

    body: a request for an operation.
    """
    request = msgspec.json.decode(body, type=JOB_KINDS["operation"].request)

    def scene_from(asked: Any) -> Scene:
        scene = scene_of(asked, robots)
        if hasattr(request, "duration"):
            require_allowed(request, scene, quotas)
        return scene

    def robot_from(key: str) -> Robot:
        robot = robot_by_id(key, robots)
        if hasattr(request, "duration"):
            require_allowed(request, scene_of_robot(robot), quotas)
        return robot

    record = answer_of_call(request, scene_from, robot_from, progress=told(report), patience=quotas.job_seconds)
    size = len(msgspec.json.encode(record))
    if size > quotas.answer_mb * 2**20:
        what = f"the answer takes {size / 2**20:.0f} MB, more than {quotas.answer_mb:g}"
        raise SceneError(what, where="request", code="too-large", remedy="ask for less: fewer samples, or shorter")
    return record
