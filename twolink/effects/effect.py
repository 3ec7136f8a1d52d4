"""What all effects have in common."""

from __future__ import annotations

import msgspec


class Effect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag=str.lower):
    """One thing a scene calls for. In a scene file its `type` is the class's name in lower case."""
