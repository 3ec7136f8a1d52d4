"""The elements of a URDF that rigid-body dynamics reads, from urdf_elements.toml."""

from pathlib import Path

import msgspec


class UrdfElement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One kind of element: what it may hold, and whether it may stand more than once in its parent.

    attributes, children: None for an element that is not looked into. foreign_attributes, foreign_children: those of
    other programs, which are reported and not applied.
    """

    attributes: tuple[str, ...] | None = None
    children: tuple[str, ...] | None = None
    foreign_attributes: tuple[str, ...] = ()
    foreign_children: tuple[str, ...] = ()
    repeatable: bool = False


_FILE = Path(__file__).parent / "urdf_elements.toml"
URDF_ELEMENTS: dict[str, UrdfElement] = msgspec.toml.decode(_FILE.read_bytes(), type=dict[str, UrdfElement])
