"""The report: one self-contained HTML page, light and dark, for a phone too."""

from __future__ import annotations

import html
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from twolink.hard.case import Motion
from twolink.hard.case_result import MET, MISSED, SAID, UNABLE, WRONG, Attempt, Result
from twolink.hard.peers import NAMES
from twolink.hard.plot import plot
from twolink.hard.table import number
from twolink.io.atomic import write_atomic

PACKAGES = ("twolink", "pin", "heyoka", "numpy", "scipy", "mujoco", "drake")
KINDS = {MET: "met", SAID: "said", WRONG: "wrong", MISSED: "missed", UNABLE: "unable"}


def write_page(results: Sequence[Result], path: Path) -> Path:
    """Write the page. Returns its path."""
    text = page(results)
    return write_atomic(path, lambda file: file.write(text.encode("utf-8")))


def page(results: Sequence[Result]) -> str:
    """The page as text."""
    style = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.case.group, []).append(result)
    body = "".join(
        f'<h2 id="{group}">{group.capitalize()}</h2>' + "".join(_case(r) for r in members)
        for group, members in groups.items()
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>twolink: hard cases</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{style}</style></head>'
        f"<body><main>{_top(results)}{body}</main></body></html>\n"
    )


def _top(results: Sequence[Result]) -> str:
    good = sum(r.passed for r in results)
    attempts = [a for r in results for a in r.ours]
    counts = ", ".join(f"{sum(a.verdict == k for a in attempts)} {k}" for k in (MET, SAID, MISSED, WRONG))
    with_peers = [r for r in results if r.peers]
    head = (
        f"<h1>Hard cases</h1><p>Cases that break simulators, through twolink's public face: why each is hard, what the "
        f"truth is, what we get at three accuracies, what it costs, and what peers get.</p>"
        f'<p class="sum"><b>{good} of {len(results)}</b> cases met their bar or said that they do not '
        f"({len(attempts)} runs and calls: {counts}).</p>"
    )
    return head + _failed(results) + (_silent(with_peers) if with_peers else "") + _how() + _index(results)


def _silent(results: Sequence[Result]) -> str:
    """The table of cases where a peer as it comes is wrong and does not say so, with our own verdict beside it."""
    rows = []
    for result in results:
        wrong = {n: a for n, a in result.peers if a.verdict == WRONG and a.default}
        if not wrong:
            continue
        met = [a for a in result.ours if a.verdict == MET]
        ours = min((f"{number(a.error)} (asked {a.setting})" for a in met[-1:]), default="no number")
        cells = "".join(f'<td class="n">{number(wrong[n].error) if n in wrong else ""}</td>' for n in NAMES.values())
        rows.append(
            f'<tr><td><a href="#{result.case.name}">{html.escape(result.case.title)}</a></td>{cells}'
            f'<td class="n">{ours}<small class="{KINDS[result.verdict]}">{result.verdict}</small></td></tr>'
        )
    heads = "".join(f'<th class="n">{html.escape(n)}</th>' for n in NAMES.values())
    return (
        f"<h2>Wrong, and silent: peers at their default settings, in {len(rows)} cases</h2>"
        f'<p class="dim">Their errors; empty: not wrong, or said so, or cannot. Ours: the finest setting that was met, '
        f"and our worst verdict over all settings.</p>"
        f'<div class="scroll"><table><tr><th>case</th>{heads}<th class="n">twolink</th></tr>'
        f"{''.join(rows)}</table></div>"
    )


def _failed(results: Sequence[Result]) -> str:
    """Our own cases that are not as they should be, by name."""
    items = "".join(
        f'<li><a href="#{r.case.name}">{html.escape(r.case.title)}</a>: '
        f'<span class="{KINDS[r.verdict]}">{r.verdict}</span></li>'
        for r in results
        if not r.passed
    )
    return f"<p>Ours that are not as they should be:</p><ul>{items}</ul>" if items else ""


def _how() -> str:
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return (
        "<details><summary>How to read this</summary><p>Error: the largest difference of q from the truth, over all "
        "samples at which the truth is known; rad or m, unless it says otherwise. Error bar: what twolink reported, "
        "without knowing the truth. Seconds: the whole call, compiling and the second solution behind the error bar "
        "included; peers without building their model.</p>"
        "<p><b>met</b>: within its bar, which is the accuracy asked for. <b>said so</b>: not, and a named error or the "
        "error bar says it. <b>wrong silently</b>: not, and nothing says it. <b>missed</b>: no answer where one was "
        "due.</p><p>Peers get the numbers of the same model, and only what they claim to do; joint limits and contacts "
        "are off. They are called wrong only when their error is above a tenth of the motion's size (1 rad, or as it "
        "says; of an energy, 1 %), whatever their tolerance promises, and silent when there was no error, warning or "
        "failed status. Their settings are in the tables; MuJoCo's loops are soft by design, with its "
        "default solref. A tolerance of a step promises nothing about the end: that "
        f'is the point.</p><p class="dim">Python {platform.python_version()}, {", ".join(found)}.</p></details>'
    )


def _index(results: Sequence[Result]) -> str:
    items = "".join(f'<li class="{KINDS[r.verdict]}"><a href="#{r.case.name}">{r.case.name}</a></li>' for r in results)
    return f'<ul class="index">{items}</ul>'


def _case(result: Result) -> str:
    case = result.case
    truth = (
        case.truth.how if isinstance(case, Motion) else "the named error that must come, or the answer where one is due"
    )
    shows = f"<dt>Shown</dt><dd>{html.escape(case.truth.quantity)}</dd>" if isinstance(case, Motion) else ""
    return (
        f'<section id="{case.name}"><h3>{html.escape(case.title)} <span class="v {KINDS[result.verdict]}">'
        f"{result.verdict}</span></h3><dl><dt>Why it is hard</dt><dd>{html.escape(case.why)}</dd>"
        f"<dt>The truth</dt><dd>{html.escape(truth)}</dd>{shows}</dl>{plot(result)}{_table(result)}</section>"
    )


def _table(result: Result) -> str:
    if not isinstance(result.case, Motion):
        rows = "".join(_probe(a) for a in result.ours)
        table = f"<table><tr><th>given</th><th>verdict</th><th>what came</th></tr>{rows}</table>"
        head = f"<summary>{len(result.ours)} calls, {result.seconds:.1f} s</summary>"
        return f'<details>{head}<div class="scroll">{table}</div></details>'
    rows = "".join(
        _row(f"twolink, accuracy {a.setting}", a, f"{a.method}, {a.steps:,} steps" if a.method else "")
        for a in result.ours
    )
    rows += "".join(_row(f"{name}{': ' if a.setting else ''}{a.setting}", a, "") for name, a in result.peers)
    return (
        '<div class="scroll"><table><tr><th>who, at what</th><th class="n">error</th><th class="n">error bar</th>'
        f'<th class="n">seconds</th><th>verdict</th></tr>{rows}</table></div>'
    )


def _row(who: str, a: Attempt, by: str) -> str:
    note = f"<small>{html.escape(by)}</small>" if by else ""
    said = f"<small>{html.escape(a.message)}</small>" if a.message else ""
    seconds = "" if a.verdict == UNABLE and not a.seconds else f"{a.seconds:.2f}"
    return (
        f'<tr><td>{html.escape(who)}{note}</td><td class="n">{number(a.error)}</td><td class="n">{number(a.bar)}</td>'
        f'<td class="n">{seconds}</td><td><span class="v {KINDS[a.verdict]}">{a.verdict}</span>{said}</td></tr>'
    )


def _probe(a: Attempt) -> str:
    return (
        f'<tr><td>{html.escape(a.setting)}</td><td><span class="v {KINDS[a.verdict]}">{a.verdict}</span></td>'
        f"<td><small>{html.escape(a.message) or 'an answer'}</small></td></tr>"
    )
