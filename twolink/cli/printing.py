"""What the command line prints: tables, JSON, and how far a long run is."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_record
from twolink.integrate.event import Event
from twolink.integrate.methods import METHODS


def print_json(value: Any) -> None:
    """One line of JSON: arrays as lists, paths as text; what is not finite is refused, as JSON has no word for it."""
    typer.echo(json.dumps(value, default=_plain, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(type(value).__name__)


def print_robots(rows: Sequence[dict[str, Any]]) -> None:
    """A line a robot: sizes, or why it is refused."""
    typer.echo(f"{'name':<28}{'nq':>4}{'nv':>4}{'mass kg':>10}  {'root':<6} from")
    for row in rows:
        if "refused" in row:
            typer.echo(f"{row['name']:<28}{'refused: ' + row['refused']}")
        else:
            sizes = f"{row['nq']:>4}{row['nv']:>4}{row['mass']:>10.4g}"
            typer.echo(f"{row['name']:<28}{sizes}  {row['root']:<6} {row['from']}")


def print_robot(robot: Robot) -> None:
    """A robot for people: joints, the load report, and how batches are answered."""
    typer.echo(f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {robot.mass:.6g} kg moving\n")
    typer.echo(f"{'joint':<32}{'kind':<24}{'q':>8}{'v':>8}{'kg moved with it':>18}")
    for j in robot_record(robot)["joints"]:
        q, v = ("-" if a == b else f"{a}" if b == a + 1 else f"{a}:{b}" for a, b in (j["q"], j["v"]))
        typer.echo(f"{j['name']:<32}{j['kind']:<24}{q:>8}{v:>8}{j['mass']:>18.6g}")
    typer.echo(f"\n{robot.report}")
    typer.echo(f"\nbatches: {_engines(robot)}")


def _engines(robot: Robot) -> str:
    """How batches of queries are answered here."""
    from twolink.dynamics.kernels import heyoka

    module = heyoka()
    if module is None:
        return "by Pinocchio alone; heyoka, which compiles them, is not installed here"
    if robot.has_mimic:
        return "by Pinocchio alone; mimic joints are not compiled"
    ready = [name for name in ("forward_dynamics", "inverse_dynamics") if robot.compiled().is_ready(name)]
    cached = f"; compiled already: {', '.join(ready)}" if ready else ""
    return f"compiled by heyoka {module.__version__} where it pays, certified against Pinocchio{cached}"


SHOWN_EVENTS = 20


def print_run(summary: dict[str, Any]) -> None:
    """A run for people: error, energy, cost, the end, and what was written."""
    error, cost = summary["error"], summary["cost"]
    typer.echo(f"{summary['scene']}: robot {summary['robot']!r}, {summary['duration']:g} s")
    typer.echo(f"  error    {'not verified' if error is None else f'at most {error:.1e} rad or m, at every sample'}")
    typer.echo(f"  energy   stays within {summary['energy_drift']:.1e} J")
    events = [str(Event(**event)) for event in summary["events"]]
    for line in events[:SHOWN_EVENTS]:
        typer.echo(f"  event    {line}")
    if len(events) > SHOWN_EVENTS:
        typer.echo(f"  event    and {len(events) - SHOWN_EVENTS} more: --json lists them all")
    if cost is not None:
        for line in _cost_lines(cost):
            typer.echo(f"  {line}")
    digits = summary.get("q_precise")
    end = np.array2string(np.array(summary["q"]), precision=15) if digits is None else f"[{' '.join(digits)}]"
    typer.echo(f"  q(end) = {end}")
    for path in summary["written"]:
        typer.echo(f"  wrote    {path}")


def _cost_lines(cost: dict[str, Any]) -> list[str]:
    """What a run took: the method and why, its setting and steps, seconds of each kind."""
    kind = "tolerance" if METHODS[cost["method"]].adaptive else "step [s]"
    rejected = f" ({cost['rejected']} more rejected)" if cost["rejected"] else ""
    return [
        f"method   {cost['method']}, {kind} {cost['tolerance']:.3g}: {cost['why'] or 'asked for'}",
        f"steps    {cost['steps']}{rejected}, {cost['evaluations']} evaluations of the dynamics",
        f"seconds  {cost['seconds']:.3g} to solve, {cost['verify_seconds']:.3g} for the error bar, "
        f"{cost['compile_seconds']:.3g} to compile or load",
    ]


def say_skipped(names: Sequence[str]) -> None:
    """Shapes that cannot be drawn, on stderr."""
    typer.echo(f"twolink: not drawn: {', '.join(names)}", err=True)


class Progress:
    """A line on stderr that tells how far a long run is; nothing for short ones and where stderr is no terminal."""

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self.start = self.last = time.monotonic()
        self.shown = False

    def __enter__(self) -> Progress:
        return self

    def __call__(self, t: float) -> None:
        now = time.monotonic()
        if now - self.start > 1 and now - self.last > 0.2 and sys.stderr.isatty():
            self.last, self.shown = now, True
            sys.stderr.write(f"\r{100 * t / self.duration:5.1f} %  t = {t:.4g} s  (Ctrl-C keeps what is done)")
            sys.stderr.flush()

    def __exit__(self, *_: object) -> None:
        if self.shown:
            sys.stderr.write("\r\033[K")
