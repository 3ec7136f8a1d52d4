"""Commands that functions are: options, defaults and their texts are those of the signature and docstring."""

from collections.abc import Callable, Sequence
from functools import partial
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import typer
from numpy.typing import ArrayLike
from typer.core import TyperGroup
from typer.main import get_command_from_info
from typer.models import CommandInfo

from twolink.cli.common import (
    Command,
    Files,
    Json,
    SceneName,
    deliver,
    require_writable,
    scene_from,
    vector_of,
    write_by_ending,
)
from twolink.io.docstrings import texts_of
from twolink.io.progress import progress_bar
from twolink.io.text import parse_numbers
from twolink.scenes import Scene
from twolink.show.figure import FORMATS
from twolink.simulation.text import RESULT_FILES, as_data


class Declared(NamedTuple):
    """A function of a scene as a command, which has the name and the help of `load`.

    load: imports the function, which takes time, and returns it. without: parameters that are no options.
    """

    load: Callable[[], Callable[..., Any]]
    without: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Of the command."""
        return self.load.__name__


DECLARED: dict[str, Declared] = {}
"""By name, as `cli.app` finds them."""


class Commands(TyperGroup):
    """The commands, with those that are declared: made when they are asked for, as their modules take time to load."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The names, as they are listed."""
        return [*super().list_commands(ctx), *DECLARED]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name; None where there is none."""
        if cmd_name not in DECLARED:
            return super().get_command(ctx, cmd_name)
        about = CommandInfo(cmd_name, cls=Command, callback=callback_of(DECLARED[cmd_name]))
        return get_command_from_info(about, pretty_exceptions_short=False, rich_markup_mode=None)


def callback_of(declared: Declared) -> Callable[..., None]:
    """The function that Typer calls, with an option for each parameter."""
    function = declared.load()
    kinds, texts = get_type_hints(function, include_extras=True), texts_of(function)

    def call(scene: str, out: list[Path] | None, as_json: bool, **given: Any) -> None:
        require_writable(out or [], (*RESULT_FILES, *FORMATS))
        made = scene_from(scene)
        arguments = {name: _read(made, name, kinds[name], value) for name, value in given.items()}
        with progress_bar() as report:
            found = function(made, **arguments, **({"progress": report} if "progress" in kinds else {}))
        deliver({"scene": scene, **as_data(found)}, found.text(), out, partial(write_by_ending, found), as_json)

    options = [Parameter(one.name, Parameter.KEYWORD_ONLY, default=one.default,
                         annotation=_option(kinds[one.name], texts.get(one.name, "")))
               for one in signature(function).parameters.values()
               if one.name not in ("scene", "progress", *declared.without)]  # fmt: skip
    common = {"scene": (SceneName, Parameter.empty), "out": (Files, None), "as_json": (Json, False)}
    for name, (kind, default) in common.items():
        options.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind))
    call.__signature__ = Signature(options)  # type: ignore[attr-defined]  # for Typer
    call.__annotations__ = {one.name: one.annotation for one in options}
    call.__doc__ = declared.load.__doc__
    return call


def _option(kind: Any, text: str) -> Any:
    """The type of an option: texts for arrays, which are read once the robot is known."""
    parts = [kind] if get_origin(kind) is Annotated else get_args(kind) or [kind]
    plain = (get_args(part)[0] if get_origin(part) is Annotated else part for part in parts)
    taken = list[str] if get_origin(kind) is Sequence else next((part for part in plain if part in (float, int)), str)
    about = typer.Option(help=text, metavar="NAME" if taken is not str and get_origin(taken) else None)
    return Annotated[taken | None if type(None) in parts else taken, about]


def _read(scene: Scene, name: str, kind: Any, value: Any) -> Any:
    """The argument of an option's value: numbers of a text, where the function takes an array."""
    if value is None or not set(get_args(kind)) >= set(get_args(ArrayLike)):
        return value
    return vector_of(scene.robot, name, value) if name in ("q", "v") else parse_numbers(name, value)
