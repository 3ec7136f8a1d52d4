"""The findings of a lint: rules, defects, and the texts, files and annotations made of them."""

from __future__ import annotations

import json
import os
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, NamedTuple

from twolink._version import __version__
from twolink.errors import QueryError
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.io.text import parse_json, read_text
from twolink.simulation.text import BaseResult

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
PAGE = "docs/how/lint.md"
_LARGEST = 2**26  # bytes of a baseline
_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"


class Rule(NamedTuple):
    """A rule: the severity of its defects unless they say another, what it expects, and what it means."""

    severity: Severity
    expects: str
    meaning: str


@cache
def rules() -> dict[str, Rule]:
    """The rules by name, as `rules.toml` declares them."""
    text = (resources.files("twolink.parts.lint") / "rules.toml").read_text("utf-8")
    return {name: Rule(*entry) for name, entry in tomllib.loads(text).items()}


class Fix(NamedTuple):
    """A certain correction: an attribute of the element on the defect's line, as it is and as it should be."""

    tag: str
    key: str
    old: str
    new: str


@dataclass(frozen=True)
class Defect:
    """A place of a file that breaks a rule.

    Attributes
    ----------
    rule : str
        Its name.
    severity : {"error", "warning", "note"}
    file : str
    line : int
        0 where it is not known: of what a macro made, or of a whole file.
    name : str
        The link or joint, or "".
    value : str
        What the file says.
    expects : str
        What the rule expects.
    cause : str
        The likely cause and the remedy, or "".
    page : str
        Where the rule is explained.
    fix : Fix or None
        A correction that is certain.
    """

    rule: str
    severity: Severity
    file: str
    line: int
    name: str
    value: str
    expects: str
    cause: str
    page: str
    fix: Fix | None = None

    @property
    def message(self) -> str:
        """The value, the expectation and the cause in one line."""
        who = f"{self.name!r}: " if self.name else ""
        return f"{who}{self.value}; expected {self.expects}" + (f"; {self.cause}" if self.cause else "")

    def __str__(self) -> str:
        place = self.file + (f":{self.line}" if self.line else "")
        return f"{place}: {self.severity} {self.rule}: {self.message}"

    @property
    def identity(self) -> tuple[str, ...]:
        """All that stays when lines are moved."""
        return self.rule, Path(self.file).name, self.name, self.value


def defect(rule: str, name: str, line: int, value: str, cause: str = "", *, severity: Severity | None = None,
           fix: Fix | None = None) -> Defect:  # fmt: skip
    """A defect of a file that is not yet named."""
    declared = rules()[rule]
    page = f"{PAGE}#{rule}"
    return Defect(rule, severity or declared.severity, "", line, name, value, declared.expects, cause, page, fix)


@dataclass(frozen=True, repr=False)
class Findings(BaseResult):
    """All defects of some files.

    Attributes
    ----------
    files : tuple of str
    defects : tuple of Defect
        By file and line.
    """

    files: tuple[str, ...]
    defects: tuple[Defect, ...]

    def of(self, severity: Severity) -> tuple[Defect, ...]:
        """The defects of one severity."""
        return tuple(one for one in self.defects if one.severity == severity)

    @property
    def errors(self) -> tuple[Defect, ...]:
        """The defects of severity "error": the file cannot be loaded, or describes what cannot be."""
        return self.of("error")

    def since(self, baseline: str | os.PathLike[str] | Findings) -> Findings:
        """The findings without those of a baseline: other findings, or a .json file of them.

        Raises
        ------
        QueryError
            The file is none.
        """
        if isinstance(baseline, Findings):
            known = Counter(one.identity for one in baseline.defects)
        else:
            known = _saved(baseline)
        known.subtract(one.identity for one in reversed(self.defects))
        new = []
        for one in reversed(self.defects):
            if known[one.identity] < 0:
                known[one.identity] += 1
                new.append(one)
        return Findings(self.files, tuple(reversed(new)))

    def __add__(self, other: Findings) -> Findings:
        return Findings(self.files + other.files, self.defects + other.defects)

    def __str__(self) -> str:
        sizes = [*((level, len(self.of(level))) for level in SEVERITIES), ("file", len(self.files))]
        *counts, files = (f"{count} {name}{'s' * (count != 1)}" for name, count in sizes)
        whole = f"{', '.join(counts)} in {files}"
        return "\n".join([whole, *(f"  {one}" for one in self.defects)])

    __repr__ = __str__

    def to_sarif(self) -> dict[str, Any]:
        """The findings as a log of SARIF 2.1.0."""
        used = list(dict.fromkeys(one.rule for one in self.defects))
        driver = {"name": "twolink lint", "version": __version__, "rules": [_described(name) for name in used]}
        return {"version": "2.1.0", "$schema": _SCHEMA,
                "runs": [{"tool": {"driver": driver}, "results": list(map(_result, self.defects))}]}  # fmt: skip

    def to_github(self) -> str:
        """The findings as workflow commands of GitHub, one a line, which annotate the files."""
        levels = {"note": "notice"}
        lines = []
        for one in self.defects:
            line = f",line={one.line}" if one.line else ""
            place = f"file={_escaped(one.file, ',:')}{line},title={one.rule}"
            lines.append(f"::{levels.get(one.severity, one.severity)} {place}::{_escaped(one.message)}")
        return "\n".join(lines)

    def formatted(self, style: str) -> str:
        """The findings as "text", "json", "sarif" or "github"."""
        if style in ("json", "sarif"):
            return json.dumps(self.to_dict() if style == "json" else self.to_sarif(), indent=1)
        return self.to_github() if style == "github" else str(self)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the findings to a .sarif or .json file. Returns the path."""
        target = path_to_write(path)
        require_format(target, (".json", ".sarif"))
        text = self.formatted(target.suffix.lower()[1:])
        return write_atomic(target, lambda file: file.write(text.encode()))


def _saved(path: str | os.PathLike[str]) -> Counter[tuple[str, ...]]:
    """The identities in a .json file of findings."""
    text = read_text(Path(path), QueryError, _LARGEST, "give the findings of fewer files")
    try:
        found = parse_json(text, "baseline")["defects"]
        return Counter((one["rule"], Path(one["file"]).name, one["name"], one["value"]) for one in found)
    except (KeyError, TypeError):
        what, remedy = f"{Path(path).name} holds no findings", "write them by Findings.save or --format json"
        raise QueryError(what, argument="baseline", remedy=remedy) from None


def _described(name: str) -> Mapping[str, Any]:
    rule = rules()[name]
    return {"id": name, "shortDescription": {"text": f"Expected: {rule.expects}"},
            "fullDescription": {"text": rule.meaning}, "help": {"text": f"{PAGE}#{name}"},
            "defaultConfiguration": {"level": rule.severity}}  # fmt: skip


def _result(one: Defect) -> Mapping[str, Any]:
    place: dict[str, Any] = {"artifactLocation": {"uri": Path(one.file).as_posix()}}
    if one.line:
        place["region"] = {"startLine": one.line}
    return {"ruleId": one.rule, "level": one.severity, "message": {"text": one.message},
            "locations": [{"physicalLocation": place}]}  # fmt: skip


def _escaped(text: str, more: Iterable[str] = "") -> str:
    """A text as workflow commands take it."""
    for sign in ("%", "\r", "\n", *more):
        text = text.replace(sign, f"%{ord(sign):02X}")
    return text
