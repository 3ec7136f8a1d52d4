"""The commands that answer dynamics questions, and that check the equations behind the answers."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from typer import Argument, Option

from twolink.cli.failures import FAILED, Misuse
from twolink.cli.options import Folders, Gravity, Json, Lock, Mimic, RobotName, Root, Unphysical, robot_from
from twolink.cli.output import show
from twolink.dynamics.named_queries import QUERIES, answer_query, parse_json, read_states


def query(
    robot: RobotName,
    what: Annotated[str, Argument(metavar="QUERY", help=", ".join(QUERIES))],
    q: Annotated[str | None, Option(help='Configuration, rad or m: "0.1 0.2", "0.1,0.2" or "[0.1, 0.2]".')] = None,
    v: Annotated[str | None, Option(help="Velocity, rad/s or m/s.", show_default="0")] = None,
    tau: Annotated[str | None, Option(help="Torques, N m or N, of forward-dynamics.", show_default="0")] = None,
    a: Annotated[str | None, Option(help="Accelerations, rad/s^2, of inverse-dynamics.", show_default="0")] = None,
    states: Annotated[Path | None, Option(help="Many states: a .json or .csv file, or - for stdin.")] = None,
    f_ext: Annotated[str | None, Option(help='Wrenches, N and N m: {"frame": [fx, fy, fz, tx, ty, tz]}.')] = None,
    frame: Annotated[str | None, Option(help="Frame of frame-pose, frame-velocity and frame-jacobian.")] = None,
    axes: Annotated[str | None, Option(help="aligned (with the world) or local.", show_default="aligned")] = None,
    method: Annotated[str | None, Option(help="aba or crba, of forward-dynamics.", show_default="aba")] = None,
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = "0 0 -9.81",
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    package_dirs: Folders = None,
    as_json: Json = False,
) -> None:
    """Ask a dynamics question about one state or many.

    \b
    twolink query two_link forward-dynamics --q "0 0" --v "0 0" --tau "1 0"
    twolink query two_link energy --states states.csv --json

    \b
    JSON: {"q": [[...], ...], "v": [[...], ...], "tau": ...}, or a list of such objects.
    CSV:  a header with columns q0, q1, ..., v0, ..., tau0, ... or q.JOINT, v.JOINT, ...; one state a row.
    """
    if q is None and states is None:
        raise Misuse("it is not given", where="q", remedy="give --q with a configuration, or --states with many")
    loaded = robot_from(robot, root, lock, gravity, mimic, unphysical, package_dirs)
    wrenches = None if f_ext is None else parse_json(f_ext, "f_ext", 'such as {"tip": [0, 0, -1, 0, 0, 0]}')
    arguments = read_states(loaded, {"q": q, "v": v, "tau": tau, "a": a}, states)
    result = answer_query(loaded, what, arguments, wrenches, method, frame=frame, axes=axes)
    with np.printoptions(precision=17, threshold=1_000_000, linewidth=120):
        show(result, "\n".join(f"{name} =\n{np.asarray(value)}" for name, value in result.items()), as_json)


def check(
    n: Annotated[int, Option(min=1, metavar="COUNT", help="Number of random arms and states.")] = 10_000,
    seed: Annotated[int, Option(min=0, metavar="SEED", help="Seed of the random numbers.")] = 0,
    as_json: Json = False,
) -> None:
    """Check the paper's equations against Pinocchio.

    Three sources are compared: Pinocchio, the hand-derived equations, and a derivation by computer algebra.
    """
    from twolink.lagrange.check import check as run_check

    result = run_check(n=n, seed=seed)
    show(result.to_dict(), result.text(), as_json)
    if not result.passed:
        raise typer.Exit(FAILED)
