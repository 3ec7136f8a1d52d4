// Pointer and keyboard in a plot: point at a time, drag to zoom, double-click or 0 for all.

import { LEFT, RIGHT } from "./axes.js";

const LEAST = 4; // px that count as a drag

/** Listen on a plot's canvas. */
export function wirePointing(plot) {
  const { canvas } = plot;
  let start = null;
  canvas.addEventListener("pointerdown", event => {
    if (event.button !== 0 || !plot.t) return;
    start = timeAt(plot, event);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    if (!plot.t) return;
    const [at, t] = timeAt(plot, event);
    if (start && Math.abs(at - start[0]) > LEAST) {
      plot.drag = [start[0], at];
      plot.draw();
    } else if (!start) plot.onPoint(t, "hover");
  });
  canvas.addEventListener("pointerup", event => {
    if (!start) return;
    const [, t] = timeAt(plot, event),
      from = start[1],
      dragged = plot.drag;
    start = plot.drag = null;
    if (dragged && Math.abs(t - from) > 0) plot.onZoom(Math.min(t, from), Math.max(t, from));
    else plot.onPoint(t, "click");
  });
  canvas.addEventListener("pointercancel", () => {
    start = plot.drag = null;
    plot.draw();
  });
  canvas.addEventListener("dblclick", () => plot.onZoom(null));
  canvas.addEventListener("keydown", event => pressed(plot, event));
}

function timeAt(plot, event) {
  const width = plot.canvas.clientWidth;
  const inside = event.clientX - plot.canvas.getBoundingClientRect().left;
  const at = Math.min(Math.max(inside, LEFT), width - RIGHT);
  return [at, plot.from + ((at - LEFT) / (width - RIGHT - LEFT)) * (plot.to - plot.from)];
}

function pressed(plot, event) {
  if (!plot.t || event.ctrlKey || event.metaKey || event.altKey) return;
  const [first, last] = [plot.t[0], plot.t.at(-1)];
  const at = plot.cursor ?? plot.from,
    span = plot.to - plot.from;
  const moved = { ArrowLeft: at - span / 50, ArrowRight: at + span / 50, Home: first, End: last }[event.key];
  const zoom = { "+": 0.5, "=": 0.5, "-": 2 }[event.key];
  if (moved !== undefined) plot.onPoint(Math.min(Math.max(moved, first), last), "key");
  else if (zoom) plot.onZoom(Math.max(first, at - (at - plot.from) * zoom), Math.min(last, at + (plot.to - at) * zoom));
  else if (event.key === "0" || event.key === "Escape") plot.onZoom(null);
  else return;
  event.preventDefault();
}
