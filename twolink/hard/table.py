"""Results as text for a terminal."""

from collections.abc import Iterator, Sequence

from twolink.hard.case import RefusalCase
from twolink.hard.case_result import INTERRUPTED, MET, SAID, Attempt, CaseResult

HEAD = f"{'case':<22}{'setting':<34}{'error':>10}{'bar':>10}{'seconds':>9}  verdict"


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
