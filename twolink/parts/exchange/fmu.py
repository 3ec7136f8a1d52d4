"""A scene as an FMU 3.0: a description, C sources, and libraries built from them; no Python is inside."""

import hashlib
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from twolink._version import __version__
from twolink.errors import MissingExtraError, QueryError, SceneError, TwolinkError, require_known
from twolink.integrate.steps import step_control
from twolink.integrate.steps.methods import METHODS
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.parts.exchange.c_code import braces, c_files, identifier
from twolink.parts.exchange.fmu_model import FmuModel, FmuVariable, fmu_model
from twolink.scenes import Scene

METHOD = METHODS["dop853"]
TOLERANCE = 1e-7  # of Co-Simulation, rad or m
MARGIN = 300.0  # ten times that of simulate's first solution: Co-Simulation cannot repeat what is not accurate enough
FIRST_STEP = 1e-3  # s; the control makes it longer or shorter
SAMPLES = 200.0  # per second, which the description proposes
_TARGETS = {
    "x86_64-linux": ("so", "x86_64-linux-gnu.2.17"),
    "aarch64-linux": ("so", "aarch64-linux-gnu.2.17"),
    "x86_64-windows": ("dll", "x86_64-windows-gnu"),
    "x86_64-darwin": ("dylib", "x86_64-macos"),
    "aarch64-darwin": ("dylib", "aarch64-macos"),
}  # FMI's names of platforms: the ending of a library, and zig's name
_DERIVED = {"N": {"kg": 1, "m": 1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2}}
_NOTES = (
    "SI units, radians. Co-Simulation holds inputs and parameters within a step, and takes quaternions back to length "
    "1 and loops back to closure after every step of its own. In Model Exchange quaternions drift with the importer's "
    "tolerance; accelerations are those of the nearest unit quaternion."
)


def export_fmu(
    scene: Scene,
    path: str | os.PathLike[str],
    parameters: Sequence[str] | None = None,
    platforms: Sequence[str] | None = None,
) -> Path:
    """Write a scene as an FMU 3.0, for Model Exchange with directional derivatives and for Co-Simulation.

    It holds C sources and compiled libraries, no Python. Its equations are compared with Pinocchio first. Inputs
    are torques of all degrees of freedom, outputs q, v, a, states of effects and the energy. Co-Simulation steps
    by DOP853, with the tolerance that its importer sets.

    Parameters
    ----------
    path : str or path
        A file that ends in .fmu. Its stem is the model's identifier.
    parameters : sequence of str, optional
        Numbers that can be set in the FMU, such as ["forearm.mass", "gravity.z"]; the others are constants, which
        take fewer operations. By default all but lengths and what is 0.
    platforms : sequence of str, optional
        Such as ["x86_64-linux", "x86_64-windows"]; by default the present one, by cc. Others take `twolink[fmu]`.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    SceneError
        An effect makes events or is called at ticks (code "no-fmu").
    CertificationError
        A function differs from Pinocchio.
    MissingExtraError
        There is no compiler for a platform.
    """
    target = path_to_write(path)
    require_format(target, (".fmu",))
    here = _present_platform()
    chosen = ([here] if here in _TARGETS else []) if platforms is None else list(platforms)
    for name in chosen:
        require_known(name, _TARGETS, QueryError, "there is no platform {!r}", argument="platforms")
    compilers = {name: _compiler(name, here) for name in chosen}
    model, stem = fmu_model(scene, parameters), identifier(target.stem)
    code, header = c_files(stem, model.functions, [f"{_title(scene)}, written by twolink {__version__}."])
    runtime = (Path(__file__).parent / "fmu.c").read_text("utf-8")
    files = {f"{stem}.c": code, f"{stem}.h": header, "fmu.c": runtime, "data.h": _data(model, stem)}
    described = _description(scene, model, stem, "")
    digest = hashlib.sha256("\0".join((described, *files.values())).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16])}}}"
    files["data.h"] = f'#define TOKEN "{token}"\n{files["data.h"]}'
    content: dict[str, str | bytes] = {
        "modelDescription.xml": _description(scene, model, stem, token),
        **{f"sources/{name}": text for name, text in files.items()},
        "sources/buildDescription.xml": _build_description(stem),
        **_libraries(files, stem, compilers),
    }
    return write_atomic(target, lambda file: _zip(file, content), error=SceneError)


def _zip(file: BinaryIO, content: Mapping[str, str | bytes]) -> None:
    """An archive without times: equal content gives equal bytes."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in content.items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)


def _title(scene: Scene) -> str:
    return scene.title or f"Robot {scene.robot.name}"


def _data(model: FmuModel, stem: str) -> str:
    """data.h: what the runtime needs to know of the model, and the method of Co-Simulation."""
    tableau: Any = METHOD.tableau
    counts = dict(zip(("NX", "NU", "NP", "NC"), model.counts, strict=True))
    stages = len(tableau.b)
    fixed = [v.start or 0.0 for v in model.variables if v.variability == "constant"]
    rows = [[*row, *[0.0] * (stages - len(row))] for row in tableau.a]
    control = {"SAFETY", "MIN_FACTOR", "MAX_FACTOR", "NO_NUMBER_FACTOR", "LAST_STEP", "ROUNDING", "MIN_SQUARE",
               "MAX_SQUARE", "FIRST_SQUARE"}  # fmt: skip
    values = {**{name: getattr(step_control, name) for name in sorted(control)}, "ERROR_ORDER": METHOD.error_order,
              "TOLERANCE": TOLERANCE, "MARGIN": MARGIN, "FIRST_STEP": FIRST_STEP,
              "LOOPS": model.equations.constraints is not None}  # fmt: skip
    sizes = "".join(f"{{{len(t.times)}, {t.rows}}}, " for t in model.tables)
    pieces = [np.nan_to_num([t.rows_at(at) for at in (-np.inf, *t.times)]) for t in model.tables]  # NaN: beyond END
    arrays = {"START[]": model.start, "FIXED[]": [*fixed, 0.0], "A[][STAGES]": rows, "B[]": tableau.b,
              "C[]": tableau.c, "E[][STAGES]": tableau.errors,
              "KNOTS[]": [0.0, *(x for t in model.tables for x in t.times)],
              "PIECES[]": [0.0, *(x for piece in pieces for x in piece.ravel())]}  # fmt: skip
    return "\n".join([
        f'#include "{stem}.h"', f"#define MODEL(name) {stem}_##name",
        f"enum {{ {', '.join(f'{k} = {n}' for k, n in counts.items())}, NQ = {model.equations.space.nq}, "
        f"STAGES = {stages}, TABLES = {len(pieces)}, NT = {sum(t.rows for t in model.tables)} }};",
        f"static const int SIZES[][2] = {{{sizes}{{0, 0}}}};",
        f"#define END {'INFINITY' if np.isinf(model.end) else model.end}",
        *(f"#define {name} {value + 0!r}" for name, value in values.items()),
        *(f"static const double {name} = {braces(value)};" for name, value in arrays.items()), "",
    ])  # fmt: skip


def _description(scene: Scene, model: FmuModel, stem: str, token: str) -> str:
    """modelDescription.xml."""
    about = f"{_title(scene)}. Effects: {', '.join(type(e).__name__ for e in scene.effects) or 'none'}. {_NOTES}"
    root = ET.Element("fmiModelDescription", fmiVersion="3.0", modelName=_title(scene), instantiationToken=token,
                      description=about, generationTool=f"twolink {__version__}",
                      variableNamingConvention="flat")  # fmt: skip
    can = {"modelIdentifier": stem, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true",
           "providesDirectionalDerivatives": "true"}  # fmt: skip
    if model.equations.constraints is None:  # rates alone do not keep loops closed
        ET.SubElement(root, "ModelExchange", can)
    ET.SubElement(root, "CoSimulation", can, canHandleVariableCommunicationStepSize="true")
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in model.variables} - {"", "1"}):
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", _base_units(unit))
    ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(float(scene.duration)),
                  tolerance=repr(TOLERANCE), stepSize=repr(1.0 / SAMPLES))  # fmt: skip
    variables, structure = ET.SubElement(root, "ModelVariables"), ET.SubElement(root, "ModelStructure")
    for i, variable in enumerate(model.variables):
        ET.SubElement(variables, "Float64", _attributes(i, variable))
    rates = [i for i, v in enumerate(model.variables) if v.of]
    outputs = [i for i, v in enumerate(model.variables) if v.causality == "output"]
    unknown = sorted({*rates, *(i for i in outputs if model.variables[i].start is None)})
    for tag, chosen in (("Output", outputs), ("ContinuousStateDerivative", rates), ("InitialUnknown", unknown)):
        for i in chosen:
            depends = " ".join(map(str, model.variables[i].depends or ()))
            known = {} if tag == "InitialUnknown" else {"dependencies": depends}
            ET.SubElement(structure, tag, {"valueReference": str(i), **known})
    return _text(root)


def _attributes(i: int, variable: FmuVariable) -> dict[str, str]:
    """Of a variable's element."""
    initial = "exact" if variable.start is not None else "calculated"
    start = {} if variable.start is None else {"start": repr(float(variable.start))}
    known = {} if variable.causality in ("independent", "input") else {"initial": initial}
    unit = {"unit": variable.unit} if variable.unit not in ("", "1") else {}
    of = {} if variable.of is None else {"derivative": str(variable.of)}
    return {"name": variable.name, "valueReference": str(i), "description": variable.about,
            "causality": variable.causality, "variability": variable.variability, **known, **unit, **start,
            **of}  # fmt: skip


def _base_units(unit: str) -> dict[str, str]:
    """The exponents of base units, such as of "kg m^2/s": what follows a stroke divides."""
    powers: dict[str, int] = {}
    for sign, name, exponent in re.findall(r"(/?)\s*([A-Za-z]+)(?:\^(\d+))?", unit):
        for base, power in _DERIVED.get(name, {name: 1}).items():
            powers[base] = powers.get(base, 0) + power * int(exponent or 1) * (-1 if sign else 1)
    return {base: str(power) for base, power in powers.items() if power}


def _build_description(stem: str) -> str:
    """buildDescription.xml: how to compile the sources."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=stem)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for name in (f"{stem}.c", "fmu.c"):
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _present_platform() -> str:
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{platform.system().lower()}"


def _compiler(name: str, here: str) -> list[str]:
    """The command that compiles for a platform."""
    if name == here and shutil.which("cc"):
        return ["cc", "-fPIC"]
    if importlib.util.find_spec("ziglang") is None:
        raise MissingExtraError(f"compiling for {name} needs zig", argument="platforms",
                                remedy="pip install 'twolink[fmu]'; or platforms=[] for sources alone")  # fmt: skip
    return [sys.executable, "-m", "ziglang", "cc", "-target", _TARGETS[name][1]]


def _libraries(files: Mapping[str, str], stem: str, compilers: Mapping[str, Sequence[str]]) -> dict[str, bytes]:
    """The compiled libraries by their places in the archive."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, "utf-8")
        for name, compiler in compilers.items():
            out = Path(folder) / f"{stem}.{_TARGETS[name][0]}"
            command = [*compiler, "-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fvisibility=hidden",
                       f"{stem}.c", "fmu.c", "-o", out.name, "-lm"]  # fmt: skip
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode:
                raise TwolinkError(f"the compiler failed: {done.stderr.strip()[-400:]}", where=" ".join(command),
                                   remedy="platforms=[] writes the sources alone", code="no-fmu")  # fmt: skip
            found[f"binaries/{name}/{out.name}"] = out.read_bytes()
    return found
