"""The command that finds parameters of a scene by simulating a measured motion."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from twolink.cli.options import Accuracy, Json, SceneName, scene_from
from twolink.cli.output import finish, require_writable, show, write
from twolink.show.progress import progress_bar

ENDINGS = (".toml", ".urdf", ".png", ".svg", ".pdf")


def fit(
    scene: SceneName,
    data: Annotated[Path, Argument(metavar="DATA", help="Measurements: a .csv, .parquet or .npz file.")],
    parameters: Annotated[
        list[str], Option(metavar="NAMES", help="What to find, with commas; * stands for any text; repeatable.")
    ],
    method: Annotated[str, Option(help="weighted, or robust (outliers).")] = "weighted",
    sigma: Annotated[
        float | None, Option(help="Standard deviation of the measurements.", show_default="from the residuals")
    ] = None,
    segments: Annotated[
        int | None, Option(min=1, metavar="COUNT", help="Of multiple shooting.", show_default="by the motion")
    ] = None,
    accuracy: Accuracy = 1e-6,
    confidence: Annotated[float, Option(help="Probability of the intervals.")] = 0.95,
    out: Annotated[
        list[Path] | None,
        Option("--out", metavar="FILE", help="Write the .toml scene or the .urdf found, or a figure (.png .svg .pdf)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find numbers of a scene that make its motion the measured one.

    The motion is simulated, with its sensitivities; no torques need to be measured. Each value comes with an interval;
    what the measurements cannot show is named, not fitted. Ctrl-C keeps the best so far.

    \b
    twolink fit arm-human log.csv --parameters "forearm.mass,effects.1.damping.*" --out fit.png
    twolink fit arm-human log.csv --parameters "forearm.*" --parameters q,v --json

    \b
    DATA: columns t, from the scene's start, and q.JOINT or v.JOINT of one joint or more. SI units, radians.
    NAMES: LINK.mass, LINK.com.x|y|z, LINK.inertia.xx|xy|xz|yy|yz|zz (about the centre of mass); or, about the frame
          of its joint, LINK.first_moment.x|y|z (m c), LINK.origin_inertia.xx|...; JOINT.armature,
          JOINT.origin.x|y|z; gravity.x|y|z; effects.1.damping.JOINT and other numbers of effects;
          q, v, q.JOINT, v.JOINT: the initial state
    """  # fmt: skip
    from twolink.identification.found_urdf import write_urdf
    from twolink.identification.scene_fit import fit as find

    paths = out or []
    require_writable(paths, ENDINGS)
    loaded = scene_from(scene)
    names = [name.strip() for text in parameters for name in text.split(",")]
    with progress_bar() as report:
        found = find(loaded, data, names, sigma=sigma, method=method, segments=segments, accuracy=accuracy,
                     confidence=confidence, progress=report)  # fmt: skip

    def write_one(path: Path) -> Path:
        if path.suffix.lower() == ".toml":
            return found.scene.save(path)
        if path.suffix.lower() == ".urdf":
            return write_urdf(found, loaded.base.visuals.text, path)
        return found.plot(path)

    written, failures = write(paths, write_one)
    files = "".join(f"\nwrote {path}" for path in written)
    show(found.to_dict() | {"scene": scene, "files": written}, f"{found}{files}", as_json)
    finish(failures, found.interrupted)
