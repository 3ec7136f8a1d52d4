"""The command that linearizes a scene."""

from pathlib import Path
from typing import Annotated

from typer import Option

from twolink.cli.options import Json, SceneName, scene_from
from twolink.cli.output import finish, require_writable, show, write
from twolink.io.text import parse_numbers
from twolink.show.figure import FORMATS


def linearize(
    scene: SceneName,
    q: Annotated[str | None, Option(help="Configuration.", show_default="the scene's")] = None,
    v: Annotated[str | None, Option(help="Velocity.", show_default="the scene's; 0 with --q")] = None,
    t: Annotated[float, Option("--time", help="Time, s, for effects that depend on it.")] = 0.0,
    inputs: Annotated[
        list[str] | None, Option("--input", metavar="JOINT", help="A motor; repeatable.", show_default="every joint")
    ] = None,
    out: Annotated[
        list[Path] | None, Option("--out", metavar="FILE", help="Draw the eigenvalues (.png .svg .pdf).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the linear equations of small motions.

    x' = A x + B u, with x = (dq, dv) and torques u at the inputs: A, B, their error, eigenvalues, what kind of
    equilibrium it is, and whether the inputs can control it.

    \b
    twolink linearize arm-swing --q "1.5707963267948966 0" --input elbow
    twolink linearize panda-hold --out eigenvalues.png --json
    """
    from twolink.control.linearization import linearize as linearize_scene

    require_writable(out or [], FORMATS)
    states = (None if text is None else parse_numbers(name, text) for name, text in (("q", q), ("v", v)))
    found = linearize_scene(scene_from(scene), *states, t=t, inputs=inputs)
    written, failures = write(out or [], found.plot)
    files = "".join(f"\nwrote {path}" for path in written)
    text = f"{found}\nA =\n{found.A}\nB =\n{found.B}{files}"
    show({"scene": scene, **found.to_dict(), "files": written}, text, as_json)
    finish(failures, interrupted=False)
