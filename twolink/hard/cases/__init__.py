"""The registry: every module here has CASES, and a new one is added to MODULES."""

from __future__ import annotations

import importlib

from twolink.errors import SceneError, nearest
from twolink.hard.case import Case

MODULES = ("pendulums", "scales", "chains", "spinning", "stiff", "loops", "events", "inputs", "refusals")


def all_cases() -> tuple[Case, ...]:
    """Every case, in order."""
    found: list[Case] = []
    for name in MODULES:
        found += importlib.import_module(f"twolink.hard.cases.{name}").CASES
    return tuple(found)


def chosen(names: list[str] | None = None, *, quick: bool = False) -> tuple[Case, ...]:
    """The cases whose names are given, or begin or end like it; all, or all but the slow ones. Raises SceneError."""
    cases = all_cases()
    if not names:
        return tuple(case for case in cases if not (quick and case.slow))
    out: list[Case] = []
    for name in names:
        here = [c for c in cases if c.name == name] or [c for c in cases if name in c.name or name == c.group]
        if not here:
            raise SceneError(
                f"there is no case {name!r}",
                where="hard-cases",
                argument="names",
                remedy=nearest(name, [c.name for c in cases]),
            )
        out += [case for case in here if case not in out and not (quick and case.slow)]
    return tuple(out)
