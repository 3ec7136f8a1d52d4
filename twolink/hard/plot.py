"""Error over time as a small inline SVG: ours with its error bars, and the peers'."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

import numpy as np

from twolink.hard.case_result import Curve, Result

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 230, 46, 12, 10, 26
FLOOR = 1e-17
Named = tuple[str, str, Curve]  # the label, the CSS class, the curve


def plot(result: Result) -> str:
    """The figure, or nothing where there is no curve."""
    series: list[Named] = []
    for k, attempt in enumerate(result.ours):
        if attempt.curve is not None:
            series.append((f"twolink, {attempt.setting}", f"own{k}", attempt.curve.thinned()))
    for k, (name, attempt) in enumerate(result.peers):
        if attempt.curve is not None:
            series.append((f"{name}: {attempt.setting}", f"peer{k}", attempt.curve.thinned()))
    series = [s for s in series if len(s[2].t) > 1 or len(s[2].t) == 1]
    return _figure(series) if series else ""


def _figure(series: Sequence[Named]) -> str:
    values = np.concatenate([np.clip(c.error, FLOOR, 1e6) for _, _, c in series])
    bars = [np.clip(c.bar, FLOOR, 1e6) for _, _, c in series if c.bar is not None]
    everything = np.concatenate([values, *bars]) if bars else values
    everything = everything[np.isfinite(everything) & (everything > FLOOR)]
    low = math.floor(math.log10(everything.min())) if everything.size else -16
    high = max(low + 2, math.ceil(math.log10(everything.max()) + 1e-9)) if everything.size else 0
    end = max(float(c.t[-1]) for _, _, c in series) or 1.0

    def at(t: float, e: float) -> str:
        x = LEFT + (WIDTH - LEFT - RIGHT) * t / end
        level = (math.log10(min(max(e, 10.0**low), 10.0**high)) - low) / (high - low)
        return f"{x:.1f},{TOP + (HEIGHT - TOP - BOTTOM) * (1 - level):.1f}"

    parts = [_axes(low, high, end)]
    for label, kind, curve in series:
        tip = f"<title>{html.escape(label)}</title>"
        if curve.bar is not None and curve.bar.max() > 0:
            path = " ".join(at(t, e) for t, e in zip(curve.t.tolist(), curve.bar.tolist(), strict=True))
            parts.append(
                f'<polyline class="{kind} bar" points="{path}"><title>{html.escape(label)}: bar</title></polyline>'
            )
        known = [(t, e) for t, e in zip(curve.t.tolist(), curve.error.tolist(), strict=True)]
        path = " ".join(at(t, e if math.isfinite(e) else 1e99) for t, e in known)
        if len(known) > 25:
            parts.append(f'<polyline class="{kind}" points="{path}">{tip}</polyline>')
        else:  # the truth is known at a few times only
            parts.append(f'<polyline class="{kind} thin" points="{path}">{tip}</polyline>')
            places = [at(t, e if math.isfinite(e) else 1e99).split(",") for t, e in known]
            dots = "".join(f'<circle cx="{x}" cy="{y}" r="2.6"/>' for x, y in places)
            parts.append(f'<g class="{kind} dots">{dots}{tip}</g>')
    legend = "".join(f'<li class="{kind}"><span></span>{html.escape(label)}</li>' for label, kind, _ in series)
    return (f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="error over time">{"".join(parts)}</svg>'
            f'<ul class="legend">{legend}<li class="barkey"><span></span>reported error bars</li></ul>')  # fmt: skip


def _axes(low: int, high: int, end: float) -> str:
    parts = []
    step = max(1, (high - low + 5) // 6)
    for k in range(low, high + 1, step):
        y = TOP + (HEIGHT - TOP - BOTTOM) * (1 - (k - low) / (high - low))
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">1e{k}</text>')
    for k in range(5):
        x = LEFT + (WIDTH - LEFT - RIGHT) * k / 4
        anchor = "start" if k == 0 else "end" if k == 4 else "middle"
        unit = " s" if k == 4 else ""
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - 8}" text-anchor="{anchor}">{end * k / 4:.3g}{unit}</text>')
    return "".join(parts)
