// Helpers for axes: round numbers, search in increasing numbers, ranges.

export const LEFT = 58,
  RIGHT = 12; // px beside the axes of a plot

/** At most about `count` round numbers in [from, to]. */
export function ticks(from, to, count) {
  const span = to - from;
  if (!(span > 0) || !Number.isFinite(span)) return [from];
  const decade = 10 ** Math.floor(Math.log10(span / count));
  const step = [1, 2, 5, 10].map(x => x * decade).find(x => span / x <= count);
  const first = Math.ceil(from / step - 1e-9);
  return Array.from({ length: Math.floor(to / step + 1e-9) - first + 1 }, (_, i) => (first + i) * step);
}

/** Where t is in increasing numbers: the index before it, and the fraction of the way to the next. */
export function locate(times, t) {
  let low = 0,
    high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  const span = times[high] - times[low];
  return [low, span > 0 ? Math.min(1, Math.max(0, (t - times[low]) / span)) : 0];
}

/** A number beside an axis whose lines are `step` apart. */
export function tickText(value, step) {
  const clean = Math.abs(value) < step * 1e-6 ? 0 : value;
  const size = Math.max(Math.abs(clean), step);
  if (size >= 1e5 || step < 1e-4)
    return clean === 0 ? "0" : clean.toExponential(1).replace(".0", "").replace("-", "−").replace("e+", "e");
  return clean.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))).replace("-", "−");
}

/** The lowest and the highest of values[begin:end]. */
export function range(values, begin = 0, end = values.length, positive = false) {
  let low = Infinity,
    high = -Infinity;
  for (let i = begin; i < end; i++) {
    const value = values[i];
    if (!Number.isFinite(value) || (positive && value <= 0)) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}
