"""The command line's options that say which robot, for all commands alike; and what counts as misuse (exit code 2)."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.named_queries import parse_numbers
from twolink.errors import TwolinkError

ROBOT_HELP = "A name (see `twolink robots`) or the path of a URDF."


class Misuse(TwolinkError):
    """The command was called wrongly: an option has a value it cannot have."""


@contextlib.contextmanager
def misuse(*options: str) -> Iterator[None]:
    """Failures whose `where` is one of these options are the caller's: they become Misuse."""
    try:
        yield
    except TwolinkError as error:
        named = re.match(r"-*([\w-]*)", error.where)
        if named and named.group(1).replace("-", "_") in options:
            raise Misuse(error.what, where=error.where, remedy=error.remedy) from None
        raise


def _load(
    robot: str | None,
    root: Annotated[str, typer.Option(help='"fixed" to the world, or "free" (floating base).')] = "fixed",
    lock: Annotated[list[str] | None, typer.Option(help='Hold a joint still: "elbow=0.5"; repeatable.')] = None,
    gravity: Annotated[str, typer.Option(help="m/s^2, along the world's axes.")] = "0 0 -9.81",
    mimic: Annotated[bool, typer.Option("--mimic", help="Couple mimic joints.")] = False,
    unphysical: Annotated[str, typer.Option(help='Impossible inertias: "refuse" or "report" them.')] = "refuse",
    package_dir: Annotated[list[Path] | None, typer.Option(help="Where package:// counts from; repeatable.")] = None,
) -> Robot | None:
    """The robot that the options describe, or None when none is named."""
    if robot is None:
        return None
    with misuse("root", "lock", "gravity", "unphysical"):
        return load_robot(
            robot,
            root=cast(Any, root),  # load_robot checks the two that are choices
            lock=_locks(lock or []),
            gravity=parse_numbers("gravity", gravity),
            mimic=mimic,
            unphysical=cast(Any, unphysical),
            package_dirs=package_dir or [],
        )


def _locks(texts: list[str]) -> dict[str, list[float]]:
    locks: dict[str, list[float]] = {}
    for text in texts:
        name, equals, value = text.rpartition("=")
        if not equals or not name.strip():
            raise Misuse(f"expected JOINT=VALUE, got {text!r}", where="lock", remedy='such as "elbow=0.5"')
        if name.strip() in locks:
            raise Misuse(f"joint {name.strip()!r} is given twice", where="lock", remedy="keep one")
        locks[name.strip()] = parse_numbers("lock", value)
    return locks


def takes_robot(*, optional: bool = False) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command, whose first parameter is a Robot, the argument and the options that say which.

    optional: the robot is the option --robot, and None when it is left out.
    """
    described: Any = (
        Annotated[str | None, typer.Option(help="Its robot, where the file does not say (.csv). " + ROBOT_HELP)]
        if optional
        else Annotated[str, typer.Argument(help=ROBOT_HELP)]
    )
    default = None if optional else inspect.Parameter.empty

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        first, *shared = inspect.signature(_load, eval_str=True).parameters.values()
        own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
        robot = first.replace(annotation=described, default=default)
        parameters = [*own, robot, *shared] if optional else [robot, *own, *shared]
        named = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]

        @functools.wraps(command)
        def called(**given: Any) -> None:
            loaded = _load(**{p.name: given.pop(p.name) for p in (first, *shared)})
            command(loaded, **given)

        called.__signature__ = inspect.Signature(named)  # type: ignore[attr-defined]  # what Typer reads
        called.__annotations__ = {p.name: p.annotation for p in named}
        return called

    return decorate
