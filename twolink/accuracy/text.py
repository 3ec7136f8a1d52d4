"""A study as text: the reference, a line a row, the front with the price of each digit, and what failed."""

from collections.abc import Iterator
from itertools import groupby

from twolink.accuracy.study_data import Failure, StudyData, in_words


def study_text(study: StudyData) -> str:
    """The whole study."""
    parts = [_head(study), _rows(study), _prices(study), _failures(study)]
    return "\n\n".join(part for part in parts if part)


def _head(study: StudyData) -> str:
    about = study.reference
    ended = "; INTERRUPTED, this is what was done" if study.interrupted else ""
    return (
        f"{study.robot}: {study.duration:g} s, {study.samples} samples; {len(study.rows)} entries "
        f"in {study.seconds:.0f} s{ended}\n"
        f"errors: the largest of q at any sample, rad or m, against\n  {about.how}\n"
        f"  its own error is {about.error:.1e}; it took {in_words(about.seconds)}"
    )


def _rows(study: StudyData) -> str:
    lines = [f"{'method':<20}{'setting':<20}{'error':>9} {'time':>11}{'evaluations':>13}{'steps':>9}{'rejected':>10}"]
    for row in study.rows:
        mark = " *" if row.front else ""
        doubt = "" if row.resolved else "  (within the reference's own error)"
        lines.append(
            f"{row.method:<20}{row.setting:<20}{row.error:>9.1e} {in_words(row.seconds):>11}{row.evaluations:>13}"
            f"{row.steps:>9}{row.rejected:>10}{mark}{doubt}"
        )
    compiled = sum(row.compile_seconds for row in study.rows)
    lines.append(f"* on the front: nothing else is both more accurate and quicker. Compiling, apart: {compiled:.1f} s.")
    return "\n".join(lines) if study.rows else ""


def _prices(study: StudyData) -> str:
    prices = study.price_of_digits()
    if not prices:
        return "no entry has an error of 0.1 or less: study a shorter duration, or with a larger budget"
    lines = ["what accuracy costs: the cheapest for each", f"{'error at most':>14}{'time':>11}{'a digit more':>14}  by"]
    for price in prices:
        more = "" if price.ratio is None else "the same" if price.ratio == 1.0 else f"x {price.ratio:.2f}"
        by = f"{price.row.method}, {price.row.setting}"
        lines.append(f"{price.accuracy:>14.0e}{in_words(price.seconds):>11}{more:>14}  {by}")
    return "\n".join(lines)


def _failures(study: StudyData) -> str:
    if not study.failures:
        return ""
    lines = ["no row from"]
    for (method, reason), group in groupby(study.failures, key=lambda f: (f.method, f.reason)):
        lines.append(f"  {method}{', '.join(_settings(group))}: {reason}")
    return "\n".join(lines)


def _settings(failures: Iterator[Failure]) -> Iterator[str]:
    for failure in failures:
        if failure.tolerance is not None:
            yield f" at tolerance {failure.tolerance:.2g}"
        elif failure.step is not None:
            yield f" at step {failure.step:.3g} s"
