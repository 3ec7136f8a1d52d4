"""The report: one self-contained HTML page, light and dark, for phones too."""

import platform
from collections.abc import Sequence
from html import escape
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from pathlib import Path
from string import Template

from twolink.hard.case import SimulationCase
from twolink.hard.case_result import INTERRUPTED, MET, MISSED, SAID, UNABLE, WRONG, Attempt, CaseResult
from twolink.hard.peers import NAMES
from twolink.hard.plot import plot
from twolink.hard.table import number
from twolink.io.atomic import write_atomic

FOLDER = Path(__file__).parent
PACKAGES = ("twolink", "pin", "heyoka", "numpy", "scipy", "mujoco", "drake")
STYLES = {MET: "met", SAID: "said", WRONG: "wrong", MISSED: "missed", INTERRUPTED: "unable", UNABLE: "unable"}


def write_page(results: Sequence[CaseResult], path: Path) -> Path:
    """Write the page. Returns its path."""
    return write_atomic(path, lambda file: file.write(page(results).encode("utf-8")))


def page(results: Sequence[CaseResult]) -> str:
    """The page as text."""
    attempts = [a for r in results for a in r.ours]
    groups = [(name, "".join(map(_case, cases))) for name, cases in groupby(results, key=lambda r: r.case.group)]
    return Template((FOLDER / "page.html").read_text(encoding="utf-8")).substitute(
        style=(FOLDER / "page.css").read_text(encoding="utf-8"),
        passed=sum(r.passed for r in results),
        cases=len(results),
        attempts=len(attempts),
        counts=", ".join(f"{sum(a.verdict == v for a in attempts)} {v}" for v in (MET, SAID, MISSED, WRONG)),
        failed=_failed(results),
        silent=_silent(results),
        python=platform.python_version(),
        packages=", ".join(filter(None, map(_versioned, PACKAGES))),
        index="".join(f'<li class="{STYLES[r.verdict]}">{_link(r, r.case.name)}</li>' for r in results),
        groups="".join(f'<h2 id="{name}">{name.capitalize()}</h2>{cases}' for name, cases in groups),
    )


def _versioned(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return ""


def _link(result: CaseResult, text: str) -> str:
    return f'<a href="#{result.case.name}">{escape(text)}</a>'


def _verdict(verdict: str) -> str:
    return f'<span class="v {STYLES[verdict]}">{verdict}</span>'


def _table(heads: Sequence[str], rows: Sequence[str], numbers: Sequence[str]) -> str:
    """A table that scrolls; the columns in `numbers` are aligned to the right."""
    cells = "".join(f'<th class="n">{head}</th>' if head in numbers else f"<th>{head}</th>" for head in heads)
    return f'<div class="scroll"><table><tr>{cells}</tr>{"".join(rows)}</table></div>'


def _failed(results: Sequence[CaseResult]) -> str:
    """The cases in which twolink failed, by name."""
    items = "".join(f"<li>{_link(r, r.case.title)}: {_verdict(r.verdict)}</li>" for r in results if not r.passed)
    return f"<p>Cases in which twolink failed, or was interrupted:</p><ul>{items}</ul>" if items else ""


def _silent(results: Sequence[CaseResult]) -> str:
    """The cases where a peer at its default setting is wrong and does not say so, with our verdict beside it."""
    wrong = [r for r in results if r.wrong_by_default]
    if not any(r.peers for r in results):
        return ""
    rows = []
    for result in wrong:
        met = [f"{number(a.error)} (asked {a.setting})" for a in result.ours if a.verdict == MET]
        errors = [number(result.wrong_by_default[n].error) if n in result.wrong_by_default else ""
                  for n in NAMES.values()]  # fmt: skip
        cells = "".join(f'<td class="n">{text}</td>' for text in errors)
        ours = f"{met[-1] if met else 'no number'}<small>{_verdict(result.verdict)}</small>"
        rows.append(f'<tr><td>{_link(result, result.case.title)}</td>{cells}<td class="n">{ours}</td></tr>')
    peers = [*NAMES.values(), "twolink"]
    return (
        f"<h2>Wrong, and silent: peers at their default settings, in {len(rows)} cases</h2>"
        f'<p class="dim">Their errors; empty: not wrong, or said so, or cannot. twolink: the finest setting that was '
        f"met, and the worst verdict over all settings.</p>{_table(['case', *peers], rows, peers)}"
    )


def _case(result: CaseResult) -> str:
    case = result.case
    facts = {"Why it is hard": case.why, "The truth": case.truth}
    if isinstance(case, SimulationCase):
        facts["Shown"] = case.quantity
        content = plot(result) + _runs(result)
    else:
        rows = [f"<tr><td>{escape(a.setting)}</td><td>{_verdict(a.verdict)}</td>"
                f"<td><small>{escape(a.message) or 'an answer'}</small></td></tr>" for a in result.ours]  # fmt: skip
        table = _table(["input", "verdict", "outcome"], rows, ())
        content = f"<details><summary>{len(rows)} calls, {result.seconds:.1f} s</summary>{table}</details>"
    shown = "".join(f"<dt>{name}</dt><dd>{escape(text)}</dd>" for name, text in facts.items())
    title = f"<h3>{escape(case.title)} {_verdict(result.verdict)}</h3>"
    return f'<section id="{case.name}">{title}<dl>{shown}</dl>{content}</section>'


def _runs(result: CaseResult) -> str:
    rows = [
        _row(f"twolink, accuracy {a.setting}", a, f"{a.method}, {a.steps:,} steps" if a.method else "")
        for a in result.ours
    ]
    rows += [_row(f"{name}: {a.setting}" if a.setting else name, a, "") for name, a in result.peers]
    numbers = ("error", "error bar", "seconds")
    return _table(["simulator, setting", *numbers, "verdict"], rows, numbers)


def _row(who: str, a: Attempt, by: str) -> str:
    seconds = "" if a.verdict == UNABLE and not a.seconds else f"{a.seconds:.2f}"
    cells = "".join(f'<td class="n">{text}</td>' for text in (number(a.error), number(a.bar), seconds))
    notes = [f"<small>{escape(text)}</small>" if text else "" for text in (by, a.message)]
    return f"<tr><td>{escape(who)}{notes[0]}</td>{cells}<td>{_verdict(a.verdict)}{notes[1]}</td></tr>"
