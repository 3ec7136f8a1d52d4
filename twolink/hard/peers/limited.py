"""A peer's run in a process of its own, which is ended when it takes too long: not every integrator can be asked to."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.hard.case import Track
from twolink.hard.peers.problem import BUDGET, CannotError, SaidError

GRACE = 5.0  # s beyond the budget, for those that look at the clock themselves


def limited(run: Callable[[], Track]) -> tuple[Track, str]:
    """The track and the first warning. Raises CannotError and SaidError as the run does, or when time is up."""
    context = multiprocessing.get_context("fork")  # the run is a closure, and the model is built already
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(run, theirs), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads do not survive a fork: the child uses none of them
        process.start()
    theirs.close()
    try:
        if not ours.poll(BUDGET + GRACE):
            raise CannotError(f"not at the end after {BUDGET:g} s")
        kind, found, said = ours.recv()
    except EOFError:
        raise SaidError("its process ended with a crash") from None
    finally:
        process.kill()
        process.join()
    if kind == "track":
        return Track(*found), said
    raise (CannotError if kind == "cannot" else SaidError)(said)


def _child(run: Callable[[], Track], pipe: Any) -> None:
    try:
        with warnings.catch_warnings(record=True) as heard, np.errstate(all="ignore"):
            warnings.simplefilter("always")
            track = run()
        pipe.send(("track", tuple(track), str(heard[0].message) if heard else ""))
    except CannotError as error:
        pipe.send(("cannot", None, str(error)))
    except Exception as error:
        pipe.send(("said", None, str(error)))
