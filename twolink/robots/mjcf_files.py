"""The files that an MJCF names: models that it includes or attaches, meshes, textures, height fields, skins.

MuJoCo opens them itself, so that they are looked for before it does.
"""

from collections.abc import Iterator
from pathlib import Path

from twolink.errors import RobotError
from twolink.io.files import confining_roots, may_be_read
from twolink.io.text import read_bytes
from twolink.robots.catalogue import Source
from twolink.robots.xml import MAX_BYTES, Element, parse_xml

_FOLDERS = ("meshdir", "texturedir", "assetdir")  # of <compiler>
_MODELS = ("include", "model")  # elements whose file is an MJCF of its own
_MOST = 200  # models that name one another


def require_readable(source: Source, element: Element) -> None:
    """Require that `files.confined` admits each file that an MJCF names, itself or by models that it includes.

    Raises
    ------
    RobotError
        Code "not-allowed": a file lies outside, or text names one, whose place nobody knows.
    """
    if confining_roots() is None:
        return
    named = [name for _, name in _names(element)]
    if source.path is None and named:
        raise _not_allowed(named[0], source, "put the model and its files in the folder, and give its path")
    if source.path is None:
        return
    models = _models(source.path, source, element)
    folders = {"", *(part.attributes[name] for model in models.values() for part in (model, *model.inside())
                     for name in _FOLDERS if name in part.attributes)}  # fmt: skip
    for name in {name for model in models.values() for _, name in _names(model)}:
        for base in {path.parent for path in models}:
            if not all(may_be_read(base / folder / name) for folder in folders):
                raise _not_allowed(name, source, "put the file in the folder, and name it from there")


def _models(path: Path, source: Source, element: Element) -> dict[Path, Element]:
    """The model and all that it includes or attaches, by their files."""
    found, left = {path: element}, [(path, element)]
    while left:
        base, model = left.pop()
        for part, name in _names(model):
            for place in {path.parent / name, base.parent / name} if part.tag in _MODELS else ():
                if not may_be_read(place):
                    raise _not_allowed(name, source, "put the file in the folder, and name it from there")
                if place in found or not place.is_file():
                    continue
                found[place] = parse_xml(read_bytes(place, RobotError, MAX_BYTES), place.name)
                left.append((place, found[place]))
                if len(found) > _MOST:
                    raise _not_allowed(name, source, f"name at most {_MOST} other models")
    return found


def _names(model: Element) -> Iterator[tuple[Element, str]]:
    """Names of files (attributes file, fileright, fileup and so on) and of the folders, each after its element."""
    for part in (model, *model.inside()):
        for key, value in part.attributes.items():
            if key.startswith("file") or key in _FOLDERS:
                yield part, value


def _not_allowed(name: str, source: Source, remedy: str) -> RobotError:
    return RobotError(f"an MJCF names the file {name[:80]!r}, which may not be read here", where=source.label,
                      remedy=remedy, code="not-allowed")  # fmt: skip
