"""How long work tells how far it is: one signature for the `progress` of every call."""

import inspect
from collections.abc import Callable

from twolink.errors import SceneError

Report = Callable[[float, float, str], None]
"""Called now and then with what is done, the total, and a label: simulated seconds, simulations, runs or pictures."""


def in_time(progress: Report | None, duration: float) -> Callable[[float], None] | None:
    """What solvers call with the simulated time [s], of a run of so many seconds. Raises SceneError."""
    if progress is None:
        return None
    try:
        inspect.signature(progress).bind(0.0, duration, "")
    except TypeError:
        raise SceneError("expected a function of what is done, the total and a label", argument="progress",
                         remedy="such as lambda done, total, label: print(label)") from None  # fmt: skip
    except ValueError:  # a function of C, whose signature is not known
        pass
    return lambda t: progress(t, duration, f"t = {t:.4g} s")
