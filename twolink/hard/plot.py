"""Error over time as a small inline SVG: ours with its error bars, and the peers'."""

import html
import math
from dataclasses import dataclass

import numpy as np

from twolink.hard.case_result import CaseResult, Curve

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 230, 46, 12, 10, 26
FLOOR, CEILING = 1e-17, 1e6
MAX_POINTS = 240
DOTS_UP_TO = 25  # points: a truth that is available at a few times only


def plot(result: CaseResult) -> str:
    """The figure, or nothing where there is no curve."""
    attempts = [(f"twolink, {a.setting}", f"own{k}", a) for k, a in enumerate(result.ours)]
    attempts += [(f"{name}: {a.setting}", f"peer{k}", a) for k, (name, a) in enumerate(result.peers)]
    series = [(label, style, thinned(a.curve)) for label, style, a in attempts if a.curve is not None]
    if not series:
        return ""
    values = np.concatenate([x for _, _, c in series for x in (c.error, c.bar) if x is not None])
    values = values[(values > FLOOR) & (values < math.inf)]
    low = math.floor(math.log10(values.min(initial=CEILING)))
    high = max(low + 2, math.ceil(math.log10(min(values.max(initial=FLOOR), CEILING)) + 1e-9))
    scale = _Scale(low, high, max(float(c.t[-1]) for _, _, c in series) or 1.0)
    drawn = "".join(_drawn(scale, html.escape(label), style, curve) for label, style, curve in series)
    legend = "".join(f'<li class="{style}"><span></span>{html.escape(label)}</li>' for label, style, _ in series)
    return (f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="error over time">{_axes(scale)}{drawn}</svg>'
            f'<ul class="legend">{legend}<li class="barkey"><span></span>reported error bars</li></ul>')  # fmt: skip


def thinned(curve: Curve) -> Curve:
    """The points with an error; of many, the largest of each interval, so that no peak is lost."""
    keep = ~np.isnan(curve.error)
    t, error, bar = curve.t[keep], curve.error[keep], None if curve.bar is None else curve.bar[keep]
    if len(t) <= MAX_POINTS:
        return Curve(t, error, bar)
    begin = np.linspace(0, len(t), MAX_POINTS + 1).astype(int)[:-1]
    last = np.append(begin[1:], len(t)) - 1
    return Curve(t[last], np.maximum.reduceat(error, begin), None if bar is None else bar[last])


@dataclass(frozen=True)
class _Scale:
    """From time [s] and error to the figure: 10^low to 10^high upwards, 0 to `end` to the right."""

    low: int
    high: int
    end: float

    def x(self, t: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * t / self.end

    def y(self, error: float) -> float:
        exponent = math.log10(min(max(error, 10.0**self.low), 10.0**self.high))
        return TOP + (HEIGHT - TOP - BOTTOM) * (self.high - exponent) / (self.high - self.low)

    def points(self, curve: Curve, values: np.ndarray) -> list[tuple[str, str]]:
        pairs = zip(curve.t.tolist(), values.tolist(), strict=True)
        return [(f"{self.x(t):.1f}", f"{self.y(error):.1f}") for t, error in pairs]


def _drawn(scale: _Scale, label: str, style: str, curve: Curve) -> str:
    """The error bar as a dashed line, the error as a line, with dots where the points are few."""
    parts = []
    if curve.bar is not None and curve.bar.max() > 0:
        parts.append(_line(scale.points(curve, curve.bar), f"{style} bar", f"{label}: bar"))
    points = scale.points(curve, curve.error)
    few = len(points) <= DOTS_UP_TO
    parts.append(_line(points, f"{style} thin" if few else style, label))
    if few:
        dots = "".join(f'<circle cx="{x}" cy="{y}" r="2.6"/>' for x, y in points)
        parts.append(f'<g class="{style} dots">{dots}<title>{label}</title></g>')
    return "".join(parts)


def _line(points: list[tuple[str, str]], style: str, title: str) -> str:
    path = " ".join(f"{x},{y}" for x, y in points)
    return f'<polyline class="{style}" points="{path}"><title>{title}</title></polyline>'


def _axes(scale: _Scale) -> str:
    parts = []
    for k in range(scale.low, scale.high + 1, max(1, (scale.high - scale.low + 5) // 6)):
        y = scale.y(10.0**k)
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">1e{k}</text>')
    for k, anchor in enumerate(("start", "middle", "middle", "middle", "end")):
        t, unit = scale.end * k / 4, " s" if k == 4 else ""
        parts.append(f'<text x="{scale.x(t):.1f}" y="{HEIGHT - 8}" text-anchor="{anchor}">{t:.3g}{unit}</text>')
    return "".join(parts)
