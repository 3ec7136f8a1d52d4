"""A peer's run in a process of its own, which is ended when it takes too long: few integrators can be interrupted."""

import multiprocessing
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.hard.peers.task import PeerError, PeerRun, UnsupportedError

MAX_SECONDS = 10.0


def run_limited(run: Callable[[], PeerRun]) -> tuple[PeerRun, str]:
    """The run's answer and its first warning, or "".

    Raises
    ------
    UnsupportedError
        After MAX_SECONDS, or as the run raises it.
    PeerError
        As the run raises it, for any other exception of the run, and when its process crashes.
    """
    context = multiprocessing.get_context("fork")  # the run is a closure, and its model is built already
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(run, sender), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads do not survive a fork: the child uses none of them
        process.start()
    sender.close()
    try:
        if not receiver.poll(MAX_SECONDS):
            raise UnsupportedError(f"not at the end after {MAX_SECONDS:g} s")
        answer, message = receiver.recv()
    except EOFError:
        raise PeerError("its process ended with a crash") from None
    finally:
        process.kill()
        process.join()
    if isinstance(answer, PeerRun):
        return answer, message
    raise answer(message)


def _child(run: Callable[[], PeerRun], pipe: Any) -> None:
    try:
        with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
            warnings.simplefilter("always")
            answer = run()
        pipe.send((answer, str(caught[0].message) if caught else ""))
    except Exception as error:
        pipe.send((UnsupportedError if isinstance(error, UnsupportedError) else PeerError, str(error)))
