"""The report: text for a terminal, and one self-contained HTML page, light and dark, for phones too, with the error
over time of ours and of peers.
"""

import platform
from collections.abc import Iterator, Sequence
from html import escape
from itertools import cycle, groupby
from pathlib import Path
from string import Template

import numpy as np

from twolink.hard.case import (
    INTERRUPTED,
    MET,
    MISSED,
    SAID,
    UNABLE,
    WRONG,
    Attempt,
    CaseResult,
    RefusalCase,
    SimulationCase,
)
from twolink.hard.peers import NAMES
from twolink.io.files import write_atomic
from twolink.io.fingerprints import versions
from twolink.show.figure import COLOURS, figure_html, new_figure, plain

FLOOR, CEILING = 1e-17, 1e6  # of the errors drawn
DOTS_UP_TO = 25  # points: a truth that is available at a few times only
HEAD = f"{'case':<22}{'setting':<34}{'error':>10}{'bar':>10}{'seconds':>9}  verdict"
FOLDER = Path(__file__).parent
PACKAGES = ("twolink", "pin", "numpy", "scipy", "mujoco", "drake")
STYLES = {MET: "met", SAID: "said", WRONG: "wrong", MISSED: "missed", INTERRUPTED: "unable", UNABLE: "unable"}


def error_plot(result: CaseResult) -> str:
    """The errors over time and, dashed, the reported error bars, as a picture; nothing where there is no curve."""
    attempts = [*((f"twolink, {a.setting}", a) for a in result.ours),
                *((f"{name}: {a.setting}", a) for name, a in result.peers)]  # fmt: skip
    drawn = [(label, a.curve) for label, a in attempts if a.curve is not None]
    if not drawn:
        return ""
    figure, axes = new_figure(1, size=(8.4, 3.0 + 0.1 * len(drawn)))
    axis = axes[0, 0]
    for colour, (label, curve) in zip(cycle(COLOURS), drawn, strict=False):
        there = curve.error > FLOOR  # where it is known, too
        axis.semilogy(curve.t[there], np.minimum(curve.error[there], CEILING), color=colour, label=plain(label),
                      marker="." if there.sum() <= DOTS_UP_TO else "")  # fmt: skip
        if curve.bar is not None:
            bar = np.minimum(curve.bar, CEILING)
            axis.semilogy(curve.t[bar > 0.0], bar[bar > 0.0], "--", color=colour, linewidth=1.0)
    axis.set(xlabel="time t (s)", ylabel="error; dashed: error bar")
    figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    return figure_html(figure, "error over time")


def lines(result: CaseResult) -> Iterator[str]:
    """A line for each attempt of a case; of refused calls, their number, and a line for each that went wrong."""
    name = result.case.name
    if isinstance(result.case, RefusalCase):
        wrong = [a for a in result.ours if a.verdict not in (MET, SAID)]
        count = f"{len(result.ours) - len(wrong)} of {len(result.case.checks)} as expected"
        yield f"{name:<22}{count:<54}{result.seconds:>9.2f}  {result.verdict}"
        yield from (f"{'':<22}{a.setting}: {a.verdict}{_note(a)}" for a in wrong)
        return
    for attempt in result.ours:
        yield _line(name, f"{attempt.setting} ({attempt.method or '-'})", attempt)
        name = ""
    for peer, attempt in result.peers:
        yield _line("", f"{peer}: {attempt.setting}", attempt)


def number(value: float | None) -> str:
    """Two digits, or a dash."""
    return "-" if value is None else f"{value:.1e}"


def summary(results: Sequence[CaseResult], left_out: Sequence[str] = ()) -> str:
    """The outcome of all cases in a few lines. left_out: the names of the slow cases that were not run."""
    passed = sum(r.passed for r in results)
    failed = [r.case.name for r in results if not r.passed and r.verdict != INTERRUPTED]
    text = f"{passed} of {len(results)} cases met their bar or said that they do not"
    text += f"; not: {', '.join(failed)}" if failed else ""
    text += f"; interrupted: {results[-1].case.name}" if results and results[-1].interrupted else ""
    text += f"\nleft out as slow: {', '.join(left_out)}" if left_out else ""
    if any(r.peers for r in results):
        wrong = sorted({r.case.name for r in results if r.wrong_by_default})
        text += f"\na peer at default settings was wrong silently in {len(wrong)}: {', '.join(wrong)}"
    return text


def _line(name: str, what: str, attempt: Attempt) -> str:
    text = f"{name:<22}{what:<34}" if len(what) < 34 else f"{name:<22}{what}\n{'':<56}"
    text += f"{number(attempt.error):>10}{number(attempt.bar):>10}{attempt.seconds:>9.2f}  "
    return text + attempt.verdict + _note(attempt)


def _note(attempt: Attempt) -> str:
    """An attempt's message in one line."""
    return f": {' '.join(attempt.message.split())}" if attempt.message else ""


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
        packages=", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items() if version),
        index="".join(f'<li class="{STYLES[r.verdict]}">{_link(r, r.case.name)}</li>' for r in results),
        groups="".join(f'<h2 id="{name}">{name.capitalize()}</h2>{cases}' for name, cases in groups),
    )


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
        content = error_plot(result) + _runs(result)
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
