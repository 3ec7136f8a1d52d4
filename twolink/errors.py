"""Every failure twolink raises on purpose: what went wrong, where, and what to do about it.

TwolinkError
├── RobotError         a robot cannot be loaded: the URDF is refused, or the name is unknown
├── QueryError         a dynamics query got an argument it cannot answer
├── SceneError         a scene names something that does not exist or cannot be simulated
│   └── ControllerError    a controller of a user's own fails, or its answer cannot be used
├── AccuracyError      the asked accuracy cannot be kept
├── CertificationError a compiled function disagrees with Pinocchio
├── ShowError          a figure or playback cannot be made
└── MissingExtraError  an optional library is needed and not installed
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any, TypeVar

E = TypeVar("E", bound="TwolinkError")


class TwolinkError(Exception):
    """The root of all failures raised by twolink.

    Parameters
    ----------
    what : str
        What went wrong: the value that was found and what was expected.
    where : str
        The file, line, link or joint it was found at; `argument` when left out.
    remedy : str
        What to do about it.
    code : str, optional
        The kind of failure for programs, lower case with hyphens. Programs decide by it, never by the message.
    argument : str, optional
        The argument of the public call that caused it.
    **data
        Plain numbers and texts that belong to the code, such as the time up to which a result can be trusted.

    Notes
    -----
    The message is `where: what; remedy` in one line. Errors survive pickling with all their attributes.
    """

    code = "error"

    def __init__(
        self, what: str, *, where: str = "", remedy: str = "", code: str = "", argument: str = "", **data: Any
    ) -> None:
        where = where or argument
        self.what, self.where, self.remedy = what, where, remedy
        self.code = code or type(self).code
        self.argument, self.data = argument, data
        message = f"{where}: {what}" if where else what
        super().__init__(f"{message}; {remedy}" if remedy else message)

    def at(self, where: str, kind: type[E] | None = None, *, argument: str = "", **data: Any) -> TwolinkError | E:
        """The failure at another place, as an error of class `kind` if there is one, with more data."""
        code = "" if self.code == type(self).code else self.code
        parts = {"where": where, "remedy": self.remedy, "code": code, "argument": argument or self.argument}
        return (kind or type(self))(self.what, **parts, **{**self.data, **data})

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.args, self.__dict__)


def _rebuild(kind: type[TwolinkError], args: tuple[object, ...], state: dict[str, Any]) -> TwolinkError:
    """Unpickle an error (Exception's own pickling loses keyword-only arguments)."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class RobotError(TwolinkError):
    """The robot cannot be loaded."""

    code = "robot"


class QueryError(TwolinkError, ValueError):
    """A dynamics query got an argument it cannot answer."""

    code = "query"


class SceneError(TwolinkError, ValueError):
    """A scene names something that does not exist, or cannot be simulated."""

    code = "scene"


class ControllerError(SceneError):
    """A controller of a user's own fails, or its answer cannot be used. `run` is the run up to then, if any.

    Its data has `t` [s], the time of the tick, and `traceback`, a text, where the controller raised an exception.
    """

    code = "controller"

    def __init__(self, what: str, *, run: Any = None, **parts: Any) -> None:
        super().__init__(what, **parts)
        self.run = run


class AccuracyError(TwolinkError):
    """The asked accuracy cannot be kept. `run` is the best trajectory that was found, with its error bar, if any.

    Code "accuracy-limit": a later sample is less accurate than asked. Its data has `trusted_until` [s], the time up to
    which the accuracy is kept, and `precision`, the precision that would reach further ("quad"), or "".
    """

    code = "accuracy"

    def __init__(self, what: str, *, run: Any = None, **parts: Any) -> None:
        super().__init__(what, **parts)
        self.run = run


class CertificationError(TwolinkError):
    """A compiled function, or Pinocchio's answer, disagrees with the reference."""

    code = "certification"


class ShowError(TwolinkError):
    """A figure or a playback cannot be made."""

    code = "show"


class MissingExtraError(TwolinkError, ImportError):
    """An optional library is needed and not installed."""

    code = "missing-extra"


def codes() -> dict[str, tuple[str, str]]:
    """The register of codes: when a failure has the code, and what to do about it.

    A refusal of the service that has no code of its own is named by its HTTP status, such as "not-found".
    """
    text = (resources.files("twolink") / "errors.toml").read_text("utf-8")
    return {code: (when, remedy) for code, (when, remedy) in tomllib.loads(text).items()}


def nearest(name: str, known: Iterable[str], usual: Mapping[str, str] | None = None) -> str:
    """A remedy for an unknown name: the nearest right one, or the list when it is short. usual: of other names."""
    if usual and name in usual:
        return f"did you mean {usual[name]!r}?"
    names = list(map(str, known))
    inside = [one for one in names if len(name) > 2 and name.lower() in one.lower()]  # jacobian of frame-jacobian
    # 200: longer ones are none, and take long to compare.
    close = inside or difflib.get_close_matches(name[:200], names, n=1, cutoff=0.6 if len(name) > 3 else 0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    listed = ", ".join(names[:16]) + (", ..." if len(names) > 16 else "")
    return f"known: {listed}" if names else "there is none"


def require_known(
    name: Any, known: Iterable[str], error: type[TwolinkError], what: str = "{!r} is unknown",
    usual: Mapping[str, str] | None = None, **parts: Any,
) -> None:  # fmt: skip
    """Require that a name is known. Raises `error` with the nearest right one; what: its message, with {!r} in it."""
    names = list(known)
    try:
        is_known = name in names
    except ValueError:  # an array
        is_known = False
    if not is_known:
        raise error(what.replace("{!r}", "{}").format(shown(name)), remedy=nearest(str(name), names, usual), **parts)


def shown(value: Any) -> str:
    """A value as errors show it: on one line, and no longer than 100 letters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 100 else f"{text[:97]}..."


def import_extra(module: str, extra: str) -> Any:
    """Import a module that needs an optional library.

    Parameters
    ----------
    module : str
        The module, such as "xarray".
    extra : str
        The extra of twolink that installs the library.

    Returns
    -------
    module
        The imported module.

    Raises
    ------
    MissingExtraError
        The library is not installed; the message has the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as missing:
        library = (missing.name or module).partition(".")[0]
        if library == "twolink":
            raise
        raise _missing(library, extra) from missing


def require_extra(library: str, extra: str) -> None:
    """As `import_extra` of a whole library that is imported later. Raises MissingExtraError."""
    if importlib.util.find_spec(library) is None:
        raise _missing(library, extra)


def _missing(library: str, extra: str) -> MissingExtraError:
    return MissingExtraError(f"{library} is not installed", remedy=f"pip install 'twolink[{extra}]'", extra=extra)
