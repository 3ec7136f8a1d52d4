"""The load report: what was read, ignored, repaired and assumed when a robot was loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["read", "ignored", "repaired", "assumed"]
KINDS: tuple[Kind, ...] = ("read", "ignored", "repaired", "assumed")


@dataclass(frozen=True)
class Finding:
    """One statement of the report: its kind, what it says, and the links, joints or files it is about."""

    kind: Kind
    what: str
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        if not self.names:
            return self.what
        shown = ", ".join(self.names[:6]) + (f", ... ({len(self.names)} in all)" if len(self.names) > 6 else "")
        return f"{self.what}: {shown}"


@dataclass(frozen=True)
class LoadReport:
    """What loading a robot found out. `print(report)` shows it; `to_dict()` is for programs."""

    source: str
    findings: tuple[Finding, ...]

    @property
    def read(self) -> tuple[Finding, ...]:
        """What was read and is used."""
        return self._of("read")

    @property
    def ignored(self) -> tuple[Finding, ...]:
        """What stands in the URDF and has no effect on the answers."""
        return self._of("ignored")

    @property
    def repaired(self) -> tuple[Finding, ...]:
        """What was wrong and has been put right."""
        return self._of("repaired")

    @property
    def assumed(self) -> tuple[Finding, ...]:
        """What the URDF does not say, or says oddly, and the value taken for it."""
        return self._of("assumed")

    def _of(self, kind: Kind) -> tuple[Finding, ...]:
        return tuple(f for f in self.findings if f.kind == kind)

    def to_dict(self) -> dict[str, object]:
        """The report as plain data."""
        groups: dict[str, object] = {k: [{"what": f.what, "names": list(f.names)} for f in self._of(k)] for k in KINDS}
        return {"source": self.source, **groups}

    def __str__(self) -> str:
        lines = [f"{self.source}"]
        for kind in KINDS:
            found = self._of(kind)
            lines.extend(f"  {kind + ':' if i == 0 else '':<10}{f}" for i, f in enumerate(found))
            if not found:
                lines.append(f"  {kind + ':':<10}nothing")
        return "\n".join(lines)
