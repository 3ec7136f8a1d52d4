"""The cases: texts and numbers in cases.toml, what needs code in MODULES.

A module may define, by the name of the case, ERRORS (error functions), SCENES (functions that make scenes) and
CHECKS (calls that must be refused).
"""

import functools
import importlib
import tomllib
from pathlib import Path
from typing import Any

from twolink.errors import SceneError, require_known
from twolink.hard.case import FOLDER, Case, RefusalCase, SimulationCase
from twolink.scenes import Scene, load_scene

MODULES = ("smooth", "loops", "events", "refusals")
ACCURACIES = (1e-3, 1e-6, 1e-9)


def all_cases() -> tuple[Case, ...]:
    """Every case, in the order of cases.toml."""
    text = (Path(__file__).parent / "cases.toml").read_text(encoding="utf-8")
    return tuple(_case(entry) for entry in tomllib.loads(text)["case"])


def select_cases(names: list[str] | None = None, *, quick: bool = False) -> tuple[Case, ...]:
    """The cases with these names, groups or parts of names; without names all. Raises SceneError (code "unknown-case").

    quick: leave out the slow ones.
    """
    cases = all_cases()
    selected: dict[str, Case] = {} if names else {case.name: case for case in cases}
    for name in names or ():
        matches = [c for c in cases if c.name == name] or [c for c in cases if name in c.name or name == c.group]
        if not matches:
            require_known(name, [c.name for c in cases], SceneError, "there is no case {!r}", where="hard-cases",
                          argument="names", code="unknown-case")  # fmt: skip
        selected |= {case.name: case for case in matches}
    return tuple(case for case in selected.values() if not (quick and case.slow))


def _case(entry: dict[str, Any]) -> Case:
    """The case of an entry of cases.toml, with its code."""
    name = entry["name"]
    if name in _code("CHECKS"):
        return RefusalCase(**entry, checks=_code("CHECKS")[name])
    load = _code("SCENES").get(name) or functools.partial(_load, entry.pop("scene"))
    accuracies = entry.pop("accuracies", ACCURACIES)
    settings = tuple(entry.pop("settings", [{"accuracy": accuracy} for accuracy in accuracies]))
    return SimulationCase(**entry, load=load, error=_code("ERRORS")[name], settings=settings)


@functools.cache
def _code(table: str) -> dict[str, Any]:
    """Entries of the modules' tables of this name, by the name of the case."""
    modules = [importlib.import_module(f"{__name__}.{module}") for module in MODULES]
    return {name: code for module in modules for name, code in getattr(module, table, {}).items()}


def _load(scene: str) -> Scene:
    path = FOLDER / f"{scene}.toml"
    return load_scene(path if path.exists() else scene)
