"""Answers of controllers: a law is called with what was measured, and what it returns must be torques."""

import traceback
from types import SimpleNamespace
from typing import Any

import numpy as np

from twolink.errors import ControllerError
from twolink.loop.laws import Own

Array = np.ndarray[Any, np.dtype[Any]]


class Measured(SimpleNamespace):
    """The inputs that a controller asked for, by name: y.q or y["q"]."""

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


def answer(place: int, joints: tuple[str, ...], own: Own, t: float, y: Measured, rows: int = 0) -> Array:
    """The torques u (m,) of a controller, by its place; its state becomes the new one. Raises ControllerError.

    rows: of how many solutions it is given, and must give, rows (rows, m); 0: it is given one solution's own.
    """
    try:
        returned = own.law(t, y, own.state)
    except Exception as error:
        raise failure(place, t, f"update raises {type(error).__name__}: {error}", code="controller-failed",
                      remedy='data["traceback"] says where; run is the motion so far',
                      traceback=traceback.format_exc()) from error  # fmt: skip
    count, what = len(joints), ""
    if isinstance(returned, tuple) and len(returned) == 2:
        try:
            u = np.asarray(returned[0], dtype=float)
        except (TypeError, ValueError):
            pass
        else:
            if u.shape == (rows, count) if rows else u.size == count and u.ndim < 2:
                own.state = returned[1]
                return u if u.ndim else u[None]
            what = f"u has the shape {u.shape}"
    what = what or f"update returns {returned!r:.80}"
    each = f" in each of {rows} rows" if rows else ""
    raise failure(place, t, what, remedy=f"return (u, state), u with {count} numbers{each}: {', '.join(joints)}",
                  code="controller-answer")  # fmt: skip


def failure(place: int, t: float, what: str, **parts: Any) -> ControllerError:
    """The error of a controller at a tick, by its place among the effects."""
    return ControllerError(what, where=f"effects[{place}] at t = {t:.9g} s", t=t, **parts)
