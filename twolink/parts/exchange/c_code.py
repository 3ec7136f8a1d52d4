"""C99 code without dependencies or allocation, from the formulas that are compiled and certified here."""

import itertools
import math
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twolink._version import __version__
from twolink.algorithms.tape import Symbol
from twolink.dynamics import Robot
from twolink.dynamics.certificates import BOUND
from twolink.errors import QueryError
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.parts.exchange.traced_functions import VECTORS, Traced, function_of, step_of

_C = {"+": "{0} + {1}", "-": "{0} - {1}", "*": "{0} * {1}", "/": "{0} / {1}", "neg": "-{0}",
      "sin": "SIN({0})", "cos": "COS({0})", "sqrt": "SQRT({0})", "exp": "EXP({0})", "tanh": "TANH({0})",
      "atan2": "ATAN2({0}, {1})", "power": "POW({0}, {1})", "less": "{0} < {1}", "less_equal": "{0} <= {1}",
      "where": "{0} != 0 ? {1} : {2}"}  # fmt: skip


def export_c(
    robot: Robot, path: str | os.PathLike[str], functions: Sequence[str] = ("forward_dynamics",)
) -> tuple[Path, Path]:
    """Write functions of a robot as a C99 file and its header, without dependencies but libm, without allocation.

    Each function takes arrays and writes its result, flat in C order, into `out`. Its formula is compared with
    Pinocchio before it is written; the certificate is a comment, and the file has a self test with test vectors.

    Parameters
    ----------
    path : str or path
        The file, which ends in .c. Its stem is the prefix of all names; the header stands beside it.
    functions : sequence of str
        "forward_dynamics", "inverse_dynamics", "bias", "gravity_torque", "mass_matrix", "energy", their
        "..._derivatives", "frame_pose:LINK", "frame_jacobian_local:LINK", "frame_jacobian_aligned:LINK"; and
        "step:METHOD", one step of an explicit Runge-Kutta method such as "step:rk4", under constant torques.

    Returns
    -------
    tuple of Path
        The file and its header.

    Raises
    ------
    QueryError
        There is no such function.
    CertificationError
        A function differs from Pinocchio.
    """
    target = path_to_write(path)
    require_format(target, (".c",))
    if isinstance(functions, str) or not functions or len({*map(identifier, functions)}) < len(functions):
        raise QueryError("expected different names of functions", argument="functions",
                         remedy='such as ["forward_dynamics"]')  # fmt: skip
    if robot.nv == 0:
        raise QueryError("no joint moves", where=f"robot {robot.name!r}", code="nothing-moves",
                         remedy='free its base: load_robot(..., root="free")')  # fmt: skip
    if not all(name.startswith("frame_") for name in functions):
        robot.require_inertia()
    prefix = identifier(target.stem)
    traced, certificates, tests = [], [], []
    for name in functions:
        one, told, vectors = (step_of if name.partition(":")[0] == "step" else function_of)(robot, name)
        traced.append(one)
        certificates.append(told)
        tests.append(_test(prefix, one, *vectors))
    about = [
        f"Robot {robot.name}, written by twolink {__version__}. SI units, radians; matrices row by row.",
        f"Gravity {', '.join(f'{g:g}' for g in robot.gravity)} m/s^2. Joints, as slices of q and v:",
        *(f"  {j.name}: {j.q.start}:{j.q.stop}, {j.v.start}:{j.v.stop}" for j in robot.joints),
        "Certificate:", *(f"  {text}" for text in certificates),
        f"cc -std=c99 -O2 -D{prefix.upper()}_SELF_TEST {target.name} -lm builds a self test, -DTWOLINK_FLOAT floats.",
    ]  # fmt: skip
    selftest = _MAIN.format(macro=f"{prefix.upper()}_SELF_TEST", tests="\n".join(tests), bound=BOUND)
    source, header = c_files(target.stem, traced, about, selftest)
    for file, text in ((target.with_suffix(".h"), header), (target, source)):
        write_atomic(file, lambda out, text=text: out.write(text.encode()))  # type: ignore[misc]
    return target, target.with_suffix(".h")


def c_files(stem: str, traced: Sequence[Traced], about: Sequence[str], selftest: str = "") -> tuple[str, str]:
    """The texts of STEM.c and STEM.h with these functions. about: lines of the comment that both begin with."""
    prefix, comment = identifier(stem), _comment(*about)
    heads = {one: _code(one, prefix) for one in traced}
    declared = "\n\n".join(f"{_comment(one.about)}\n{heads[one][0]};" for one in traced)
    header = _HEADER.format(about=comment, guard=f"{prefix.upper()}_H", prefix=prefix, declared=declared)
    bodies = "\n\n".join(f"{head} {{\n{body}\n}}" for head, body in heads.values())
    return _SOURCE.format(about=comment, header=stem, prefix=prefix, bodies=bodies, selftest=selftest), header


def _code(traced: Traced, prefix: str) -> tuple[str, str]:
    """The function's head, and its body."""
    names = {symbol.key: name if len(symbols) == 1 else f"{name}[{i}]"
             for name, symbols in traced.arguments for i, symbol in enumerate(symbols)}  # fmt: skip
    real = f"{prefix}_real"
    taken = [f"{real} {name}" if len(s) == 1 else f"const {real} {name}[{len(s)}]" for name, s in traced.arguments]
    head = f"void {prefix}_{identifier(traced.name)}({', '.join(taken)}, {real} out[{len(traced.outputs)}])"

    def operand(x: Any) -> str:
        return names[x] if isinstance(x, int) else "K(NAN)" if math.isnan(x) else f"K({float(x)!r})"

    lines = []
    for key, (kind, *operands) in traced.needed():
        names[key] = f"x{key}"
        lines.append(f"  const real x{key} = {_C[kind].format(*map(operand, operands))};")
    lines += [f"  out[{i}] = {operand(x.key if isinstance(x, Symbol) else x)};" for i, x in enumerate(traced.outputs)]
    unused = [name for name, symbols in traced.arguments if not any(
        re.search(rf"\b{name}\b", line.partition("=")[2]) for line in lines)]  # fmt: skip
    return head, "\n".join([*(f"  (void){name};" for name in unused), *lines])


def _test(prefix: str, traced: Traced, columns: list[np.ndarray], expected: np.ndarray, scale: np.ndarray) -> str:
    """The self test of a function."""
    name, width = identifier(traced.name), len(traced.outputs)
    inputs = np.concatenate([column.reshape(len(column), -1) for column in columns], axis=1)
    starts = itertools.accumulate((len(symbols) for _, symbols in traced.arguments), initial=0)
    passed = [f"{'*' if len(symbols) == 1 else ''}(in[k] + {start})"
              for (_, symbols), start in zip(traced.arguments, starts, strict=False)]  # fmt: skip
    return f"""  {{
    static const real in[{VECTORS}][{inputs.shape[1]}] = {braces(inputs, "K({!r})")};
    static const real expected[{VECTORS}][{width}] = {braces(expected, "K({!r})")};
    static const real scale[{VECTORS}] = {braces(scale, "K({!r})")};
    real out[{width}];
    for (int k = 0; k < {VECTORS}; k++) {{
      {prefix}_{name}({", ".join(passed)}, out);
      failed += compare("{traced.name}", {width}, out, expected[k], scale[k]);
    }}
  }}"""


def braces(values: Iterable[Any], form: str = "{!r}") -> str:
    """Numbers as C initializes an array with them, each in a form."""
    return "{" + ", ".join(braces(x, form) if np.ndim(x) else form.format(float(x)) for x in values) + "}"


def identifier(name: str) -> str:
    """A name of C."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{text}" if text[:1].isdigit() else text


def _comment(*lines: str) -> str:
    """A comment of C; no text ends it early, and none is more than a line."""
    plain = (re.sub(r"[^ -~]", "?", line).replace("*/", "* /").replace("/*", "/ *") for line in lines)
    return "\n".join(["/*", *(f" * {line}" for line in plain), " */"])


_HEADER = """{about}
#ifndef {guard}
#define {guard}

#ifdef TWOLINK_FLOAT
typedef float {prefix}_real;
#else
typedef double {prefix}_real;
#endif

#ifdef __cplusplus
extern "C" {{
#endif

{declared}

#ifdef __cplusplus
}}
#endif

#endif
"""
_SOURCE = """{about}
#include "{header}.h"
#include <math.h>

#ifdef TWOLINK_FLOAT
#define SIN sinf
#define COS cosf
#define SQRT sqrtf
#define EXP expf
#define TANH tanhf
#define ATAN2 atan2f
#define POW powf
#else
#define SIN sin
#define COS cos
#define SQRT sqrt
#define EXP exp
#define TANH tanh
#define ATAN2 atan2
#define POW pow
#endif
#define K(x) ((real)(x))

typedef {prefix}_real real;

{bodies}

{selftest}"""
_MAIN = """#ifdef {macro}
#include <float.h>
#include <stdio.h>

static int compare(const char *name, int n, const real *out, const real *expected, real scale) {{
  const double bound = {bound!r} * (sizeof(real) == sizeof(float) ? FLT_EPSILON / DBL_EPSILON : 1.0);
  double worst = 0.0;
  for (int i = 0; i < n; i++) {{
    const double error = fabs((double)out[i] - (double)expected[i]) / (double)scale;
    worst = error > worst || error != error ? error : worst;
  }}
  printf("%s: error %.1e of its scale, bound %.0e\\n", name, worst, bound);
  return !(worst <= bound);
}}

int main(void) {{
  int failed = 0;
{tests}
  return failed != 0;
}}
#endif
"""
