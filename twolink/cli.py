"""The command line: parse, call, print. Exit codes: 0 done, 1 failed, 2 misused."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from twolink import __version__
from twolink.dynamics import Robot, load_robot
from twolink.errors import QueryError, TwolinkError
from twolink.query import QUERIES, answer_query, read_states

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Rigid-body dynamics from a URDF: queries, experiments and playback.",
    epilog="ROBOT is a name (see `twolink robots`), or the path of a URDF. SI units and radians throughout.",
)

RobotArgument = Annotated[str, typer.Argument(help="A name (see `twolink robots`) or the path of a URDF.")]
RootOption = Annotated[str, typer.Option("--root", help='"fixed" to the world, or "free" (floating base).')]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
OutOption = Annotated[Path, typer.Option("--out", help="The folder to write into.")]


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, default=_plain, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(type(value).__name__)


def _robot(name: str, root: str = "fixed", mimic: bool = False, package_dirs: list[Path] | None = None) -> Robot:
    return load_robot(name, root=_root(root), mimic=mimic, package_dirs=package_dirs or [])


def _root(root: str) -> Literal["fixed", "free"]:
    if root not in ("fixed", "free"):
        raise typer.BadParameter('expected "fixed" or "free"', param_hint="--root")
    return "free" if root == "free" else "fixed"


@app.callback(invoke_without_command=True)
def _main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"twolink {__version__}")
        raise typer.Exit


@app.command()
def robots(as_json: JsonOption = False) -> None:
    """List the robots known by name, with nq, nv, mass and the root they are meant to have."""
    from twolink.robots.catalogue import catalogue_names, find

    rows: list[dict[str, Any]] = []
    for name in catalogue_names():
        entry = find(name)
        row: dict[str, Any] = {"name": name, "from": entry.origin, "root": entry.usual_root}
        try:
            robot = load_robot(name, root=entry.usual_root)
            row |= {"nq": robot.nq, "nv": robot.nv, "mass": robot.mass}
        except TwolinkError as error:
            row |= {"refused": str(error)}
        rows.append(row)
    if as_json:
        _print_json(rows)
        return
    typer.echo(f"{'name':<28}{'nq':>4}{'nv':>4}{'mass kg':>10}  {'root':<6} from")
    for row in rows:
        if "refused" in row:
            typer.echo(f"{row['name']:<28}{'refused: ' + row['refused']}")
        else:
            typer.echo(
                f"{row['name']:<28}{row['nq']:>4}{row['nv']:>4}{row['mass']:>10.4g}  {row['root']:<6} {row['from']}"
            )


@app.command()
def inspect(
    robot: RobotArgument,
    root: RootOption = "fixed",
    mimic: Annotated[bool, typer.Option("--mimic", help="Couple mimic joints.")] = False,
    package_dir: Annotated[list[Path] | None, typer.Option(help="Where package:// counts from; repeatable.")] = None,
    cross_check: Annotated[bool, typer.Option("--cross-check", help="Compare with yourdfpy's reading.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a URDF holds: joints, masses, and what was read, ignored, repaired and assumed."""
    loaded = _robot(robot, root, mimic, package_dir)
    second = None
    if cross_check:
        from twolink.robots.second_reading import compare

        second = compare(loaded)
    joints = [
        {
            "name": j.name,
            "kind": loaded.model.joints[j.index].shortname().removeprefix("JointModel"),
            "q": [j.q.start, j.q.stop],
            "v": [j.v.start, j.v.stop],
            "mass": loaded.model.inertias[j.index].mass,
        }
        for j in loaded.joints
    ]
    if as_json:
        _print_json(
            {
                "name": loaded.name,
                "nq": loaded.nq,
                "nv": loaded.nv,
                "mass": loaded.mass,
                "joints": joints,
                "report": loaded.report.to_dict(),
                **({"second_reading": second} if second else {}),
            }
        )
        return
    typer.echo(f"{loaded.name}: nq = {loaded.nq}, nv = {loaded.nv}, {loaded.mass:.6g} kg moving\n")
    typer.echo(f"{'joint':<32}{'kind':<24}{'q':>8}{'v':>8}{'kg moved with it':>18}")
    for j in joints:
        q, v = ("-" if a == b else f"{a}" if b == a + 1 else f"{a}:{b}" for a, b in (j["q"], j["v"]))
        typer.echo(f"{j['name']:<32}{j['kind']:<24}{q:>8}{v:>8}{j['mass']:>18.6g}")
    typer.echo(f"\n{loaded.report}")
    typer.echo(f"\nbatches: {_engines(loaded)}")
    if second:
        typer.echo(f"\nsecond reading (yourdfpy): {second['text']}")


def _engines(robot: Robot) -> str:
    """How batches of queries are answered here."""
    from twolink.dynamics.kernels import heyoka

    module = heyoka()
    if module is None:
        return "by Pinocchio alone; heyoka, which compiles them, is not installed here"
    ready = [name for name in ("forward_dynamics", "inverse_dynamics") if robot.compiled().is_ready(name)]
    cached = f"; compiled already: {', '.join(ready)}" if ready else ""
    return f"compiled by heyoka {module.__version__} where it pays, certified against Pinocchio{cached}"


@app.command()
def query(
    robot: RobotArgument,
    what: Annotated[str, typer.Argument(help=", ".join(QUERIES))],
    q: Annotated[str | None, typer.Option(help='Configuration: "0.1 0.2", "0.1,0.2" or "[0.1, 0.2]".')] = None,
    v: Annotated[str | None, typer.Option(help="Velocity; zero when left out.")] = None,
    tau: Annotated[str | None, typer.Option(help="Torques (forward-dynamics); zero when left out.")] = None,
    a: Annotated[str | None, typer.Option(help="Accelerations (inverse-dynamics); zero when left out.")] = None,
    states: Annotated[Path | None, typer.Option(help="Many states: a .json or .csv file, or - for stdin.")] = None,
    f_ext: Annotated[str | None, typer.Option("--f-ext", help='JSON: {"frame": [fx, fy, fz, tx, ty, tz]}.')] = None,
    method: Annotated[str, typer.Option(help="Of forward-dynamics: aba or crba.")] = "aba",
    root: RootOption = "fixed",
    as_json: JsonOption = False,
) -> None:
    """Ask a dynamics question about one state, or about many from a file or stdin.

    \b
    JSON: {"q": [[...], ...], "v": [[...], ...], "tau": ...}, or a list of such objects.
    CSV:  a header with columns q0, q1, ..., v0, ..., tau0, ... or q.JOINT, v.JOINT, ...; a row a state.
    """
    loaded = _robot(robot, root)
    given = {"q": q, "v": v, "tau": tau, "a": a}
    arguments = read_states(loaded, given, states)
    wrenches = _parse_json(f_ext) if f_ext else None
    result = answer_query(loaded, what, arguments, wrenches, method)
    if as_json:
        _print_json(result)
        return
    for name, value in result.items():
        typer.echo(
            f"{name} =\n{np.array2string(np.asarray(value), precision=17, threshold=1_000_000, max_line_width=120)}"
        )


def _parse_json(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise QueryError(f"not JSON: {error}", where="--f-ext", remedy='such as {"tip": [0, 0, -1, 0, 0, 0]}') from None


@app.command()
def check(
    n: Annotated[int, typer.Option(min=1, help="Random arms and states.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    as_json: JsonOption = False,
) -> None:
    """Check Pinocchio, the hand-derived equations and a derivation by machine against each other."""
    from twolink.lagrange.check import check as run_check

    report = run_check(n=n, seed=seed)
    if as_json:
        _print_json(report.to_dict())
    else:
        typer.echo(report.text())
    if not report.passed:
        raise typer.Exit(1)


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="A bundled scene, or the path of a scene file (.toml).")],
    duration: Annotated[float | None, typer.Option(help="Seconds; the scene's own when left out.")] = None,
    accuracy: Annotated[float, typer.Option(help="Bound on the global error of q, rad or m.")] = 1e-6,
    method: Annotated[str, typer.Option(help="auto, dop853, rk45 or radau.")] = "auto",
    samples: Annotated[float, typer.Option(help="Samples a second.")] = 200.0,
    no_verify: Annotated[bool, typer.Option("--no-verify", help="Skip the second solution: no error bar.")] = False,
    out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Write samples (.csv .parquet .npz), a figure (.png .svg .pdf) or a playback (.html); repeatable."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate a scene and say how accurate the answer is and what it cost."""
    from twolink.scenes import load_scene
    from twolink.simulate import simulate

    loaded = load_scene(scene)
    length = loaded.duration if duration is None else duration
    with _Progress(length) as progress:
        result = simulate(
            loaded, length, accuracy, method=method, samples=samples, verify=not no_verify, progress=progress
        )
    for path in out or []:
        writer = {".html": result.playback, ".png": result.plot, ".svg": result.plot, ".pdf": result.plot}
        writer.get(path.suffix, result.save)(path)
    error = None if result.error is None else float(result.error.max())
    cost = result.cost
    summary = {
        "scene": scene,
        "robot": loaded.robot.name,
        "duration": float(result.t[-1]),
        "error": error,
        "energy_drift": float(np.ptp(result.energy)),
        "q": result.q[-1],
        "v": result.v[-1],
        "cost": None if cost is None else vars(cost),
        "interrupted": result.interrupted,
        "written": out or [],
    }
    if as_json:
        _print_json(summary)
    else:
        _print_run(summary)
    if result.interrupted:
        raise typer.Exit(1)


def _print_run(summary: dict[str, Any]) -> None:
    error, cost = summary["error"], summary["cost"]
    if summary["interrupted"]:
        typer.echo("interrupted: what was done is kept")
    typer.echo(f"{summary['scene']}: robot {summary['robot']!r}, {summary['duration']:g} s")
    typer.echo(f"  error    {'not verified' if error is None else f'at most {error:.1e} rad or m, at every sample'}")
    typer.echo(f"  energy   stays within {summary['energy_drift']:.1e} J")
    typer.echo(
        f"  cost     {cost['method']}, {cost['steps']} steps, {cost['evaluations']} evaluations, "
        f"{cost['seconds']:.3g} s, and {cost['verify_seconds']:.3g} s for the error bar"
    )
    typer.echo(f"  q(end) = {np.array2string(summary['q'], precision=15)}")
    for path in summary["written"]:
        typer.echo(f"  wrote    {path}")


class _Progress:
    """A line on stderr that tells how far a long run is; nothing for short ones and where stderr is no terminal."""

    def __init__(self, duration: float) -> None:
        import time

        self.duration, self.clock = duration, time.monotonic
        self.start = self.last = self.clock()
        self.shown = False

    def __enter__(self) -> _Progress:
        return self

    def __call__(self, t: float) -> None:
        now = self.clock()
        if now - self.start > 1 and now - self.last > 0.2 and sys.stderr.isatty():
            self.last, self.shown = now, True
            sys.stderr.write(f"\r{100 * t / self.duration:5.1f} %  t = {t:.4g} s  (Ctrl-C keeps what is done)")
            sys.stderr.flush()

    def __exit__(self, *_: object) -> None:
        if self.shown:
            sys.stderr.write("\r\033[K")


@app.command()
def paper(out: OutOption = Path("out"), as_json: JsonOption = False) -> None:
    """Draw the paper's figures 6 to 13 again, and answer each of its claims with a number."""
    from twolink.show.paper import study

    result = study(out)
    if as_json:
        _print_json(
            {
                "difference": result.difference,
                "claims": [vars(c) for c in result.claims],
                "pictures": list(result.pictures),
            }
        )
    else:
        typer.echo(result.text())


@app.command()
def play(
    file: Annotated[Path, typer.Argument(help="A saved trajectory: .npz, .parquet or .csv.")],
    robot: Annotated[str | None, typer.Option(help="Its robot, where the file does not name one (.csv).")] = None,
    root: RootOption = "fixed",
    speed: Annotated[float, typer.Option(help="2 is twice as fast.")] = 1.0,
    html: Annotated[Path | None, typer.Option(help="Write a standalone page instead of opening a browser.")] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address, open nothing.")] = False,
) -> None:
    """Play a saved trajectory in the browser, at true speed, or write it as a standalone page."""
    from twolink.trajectory import Trajectory

    loaded = Trajectory.load(file, None if robot is None else _robot(robot, root))
    if html is not None:
        typer.echo(f"wrote {loaded.playback(html, speed=speed)}")
        return
    loaded.play(speed=speed, open_browser=not no_browser)


def main() -> None:
    """The entry point: failures end in one line on stderr, never in a traceback."""
    try:
        app(standalone_mode=False)
    except typer.Exit as stop:
        sys.exit(stop.exit_code)
    except TwolinkError as error:
        _fail(str(error), 1)
    except KeyboardInterrupt:
        _fail("interrupted", 1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except Exception as error:
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # click's own: the call was misused
            _fail(error.format_message() or "see --help", 2)
        raise


def _fail(message: str, code: int) -> None:
    line = " ".join(message.split())
    if line:
        sys.stderr.write(f"twolink: {line}\n")
    sys.exit(code)


if __name__ == "__main__":
    main()
