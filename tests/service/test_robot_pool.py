"""Loaded robots: found by id, and dropped when they take too much memory."""

import pytest

from twolink.service.problems import Refusal
from twolink.service.robot_pool import RobotPool
from twolink.service.settings import Settings


class OneAtATime:
    """A store that is asked for single robots only: their list may be long."""

    def robot(self, _: str) -> None:
        return None


def test_an_unknown_robot_is_refused_without_a_look_at_all_uploads() -> None:
    pool = RobotPool(Settings(data=""), OneAtATime(), None)  # type: ignore[arg-type]
    with pytest.raises(Refusal, match="two_link") as refused:
        pool.require("two_lnk" + "k" * 10)
    assert refused.value.status == 404
