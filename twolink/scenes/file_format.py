"""What a scene file may say: the schema of its tables, and the JSON Schema that editors and clients use."""

import functools
import inspect
import operator
from typing import Annotated, Any, Literal

import msgspec

from twolink.effects import TYPES, effect_class

JointValues = dict[str, float | list[float]]


class RobotEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The robot of a scene: its source, with the root and the locked joints as in `load_robot`."""

    source: str
    root: Literal["fixed", "free"] = "fixed"
    lock: JointValues = {}


class SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The tables of a scene file. States are by joint name; other joints are neutral and at rest."""

    robot: str | RobotEntry
    title: str = ""
    duration: Annotated[float, msgspec.Meta(gt=0)] = 10.0
    q: JointValues = {}
    v: JointValues = {}
    effects: list[dict[str, Any]] = []


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of scene files, with the tables of all effects."""
    schema = msgspec.json.schema(SceneFile)
    effects = msgspec.json.schema(functools.reduce(operator.or_, [effect_class(name) for name in TYPES]))
    schema["$defs"] |= effects.pop("$defs")
    for name in ("Engage", "Release"):
        schema["$defs"][name]["properties"]["of"] = effects
    schema["$defs"]["SceneFile"]["properties"]["effects"]["items"] = effects
    for definition in schema["$defs"].values():
        _describe_fields(definition)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _describe_fields(definition: dict[str, Any]) -> None:
    """Move the description of each field from the section "Parameters" of a class's docstring to the field."""
    summary, _, sections = inspect.cleandoc(definition.get("description", "")).partition("\nParameters\n----------\n")
    lines = sections.partition("\n\n")[0].splitlines()
    fields: list[str] = []
    for line in lines:
        if line.startswith(" "):
            for field in fields:
                text = definition["properties"][field].get("description", "")
                definition["properties"][field]["description"] = f"{text} {line.strip()}".lstrip()
        else:
            fields = [name for name in line.partition(" : ")[0].split(", ") if name in definition["properties"]]
    if lines:
        definition["description"] = summary.strip()
