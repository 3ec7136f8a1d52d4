"""Results as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from twolink.hard.case_result import WRONG, Attempt, Result

HEAD = f"{'case':<22}{'setting':<34}{'error':>10}{'bar':>10}{'seconds':>9}  verdict"


def lines(result: Result) -> Iterable[str]:
    """A line for each attempt of a case; of refusals, a line for those that went wrong, and how many there are."""
    name = result.case.name
    if not any(a.curve or a.method for a in result.ours) and len(result.ours) > 3:
        right = [a for a in result.ours if a.verdict not in (WRONG, "missed")]
        count = f"{len(right)} of {len(result.ours)} as they should be"
        yield f"{name:<22}{count:<54}{result.seconds:>9.2f}  {result.verdict}"
        wrong = [a for a in result.ours if a not in right]
        yield from (f"{'':<22}{a.setting}: {a.verdict}: {a.message[:150]}" for a in wrong)
        return
    for k, attempt in enumerate(result.ours):
        yield _line(name if k == 0 else "", f"{attempt.setting} ({attempt.method or '-'})", attempt)
    for peer, attempt in result.peers:
        yield _line("", f"{peer}: {attempt.setting}", attempt)


def _line(name: str, what: str, attempt: Attempt) -> str:
    note = f": {attempt.message[:110]}" if attempt.message else ""
    text = f"{name:<22}{what[:53]:<34}"
    if len(what) > 33:
        text = f"{name:<22}{what}\n{'':<56}"
    return f"{text}{number(attempt.error):>10}{number(attempt.bar):>10}{attempt.seconds:>9.2f}  {attempt.verdict}{note}"


def number(value: float | None) -> str:
    """Two digits, or a dash."""
    return "-" if value is None else f"{value:.1e}"


def summary(results: Sequence[Result]) -> str:
    """What came of it all, in a few lines."""
    failed = [r.case.name for r in results if not r.passed]
    peers = sorted({r.case.name for r in results for _, a in r.peers if a.verdict == WRONG and a.default})
    text = f"{len(results) - len(failed)} of {len(results)} cases met their bar or said that they do not"
    text += f"; not: {', '.join(failed)}" if failed else ""
    if any(r.peers for r in results):
        text += f"\na peer at default settings was wrong silently in {len(peers)}: {', '.join(peers)}"
    return text
