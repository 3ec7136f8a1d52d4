"""The order of imports, sizes of files and functions, names of classes, and docs/architecture.md with its picture."""

import ast
import functools
import graphlib
import importlib.metadata
import inspect
import itertools
import re
import statistics
import sys
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import pytest

from twolink.integrate.core.motion import drive

ROOT = Path(__file__).parents[1]
LONGEST_MODULE, MEDIAN_MODULE, LONGEST_FUNCTION = 250, 150, 50  # lines of code
EXAMPLES = {"effects/my_effect.py", "hard/peers/my_peer.py", "scenes/bundled/my_scene.toml"}


def layers(container: str = "twolink") -> list[str]:
    """The rooms in a package from the top down, as pyproject.toml gives them to import-linter."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    rooms = next(contract["layers"] for contract in contracts if contract["containers"] == [container])
    return [room for layer in rooms for room in re.findall(r"\w+", layer) if not room.startswith("_")]


@functools.cache
def syntax(text: str) -> SimpleNamespace:
    """The nodes of a file that tests look at: imports, constants, joined (f-strings), classes, functions, module."""
    kinds = {"imports": (ast.Import, ast.ImportFrom), "constants": ast.Constant, "joined": ast.JoinedStr,
             "module": ast.Module, "classes": ast.ClassDef,
             "functions": (ast.FunctionDef, ast.AsyncFunctionDef)}  # fmt: skip
    nodes = list(ast.walk(ast.parse(text)))
    return SimpleNamespace(**{name: [n for n in nodes if isinstance(n, kind)] for name, kind in kinds.items()})


def sources() -> dict[str, str]:
    """The text of every module of the package, by its name."""
    texts = {}
    for file in sorted((ROOT / "twolink").rglob("*.py")):
        name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        texts[name.removesuffix(".__init__")] = file.read_text("utf-8")
    return texts


def imports(texts: Mapping[str, str]) -> dict[str, set[str]]:
    """The modules that each module imports, also within functions and for type checking only."""
    graph: dict[str, set[str]] = {}
    for module, text in texts.items():
        names = set()
        for node in syntax(text).imports:
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif node.module:
                full = [f"{node.module}.{alias.name}" for alias in node.names]
                names |= {name if name in texts else node.module for name in full}
        graph[module] = (names & texts.keys()) - {module}
    return graph


FACES = ("twolink", "twolink.__main__", "twolink.cli")  # which stand above all, and load names when they are used


def names_in_strings(texts: Mapping[str, str]) -> dict[str, set[str]]:
    """The modules that each module may import by a name in a string: "twolink.a.b", "a.b" or f"twolink.a.{name}"."""
    graph: dict[str, set[str]] = {module: set() for module in texts}
    for module, text in texts.items():
        if module in FACES[:2] or module.startswith(FACES[2]):
            continue
        for node in syntax(text).constants:
            if isinstance(node.value, str) and "." in node.value:
                named = {node.value, f"twolink.{node.value}"} & texts.keys()
                graph[module] |= {one for one in named if one.count(".") > 1}  # a room's name may be that of its data
        for node in syntax(text).joined:
            if isinstance(first := node.values[0], ast.Constant):
                start = str(first.value)
                if start.startswith("twolink.") and len(node.values) > 1:
                    graph[module] |= {one for one in texts if one.startswith(start)}
        graph[module] -= {module}
    return graph


def first_circle(graph: Mapping[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle; empty where there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def upward(graph: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Imports of a room from a room above it."""
    order = layers()
    rooms = {module: parts[1] for module in graph if len(parts := module.split(".")) > 1 and parts[1] in order}
    pairs = [(a, b) for a, names in graph.items() for b in names if a in rooms and b in rooms]
    return [(a, b) for a, b in pairs if order.index(rooms[b]) < order.index(rooms[a])]


def test_no_module_imports_in_a_circle() -> None:
    graph = imports(sources())
    assert len(graph) > 200
    assert first_circle(graph) == []


def by_any_name(texts: Mapping[str, str]) -> dict[str, set[str]]:
    """Imports by statements and by names in strings."""
    graph, named = imports(texts), names_in_strings(texts)
    return {module: graph[module] | named[module] for module in graph}


def test_no_module_imports_in_a_circle_by_a_name_in_a_string() -> None:
    texts = sources()
    assert first_circle(by_any_name(texts)) == []
    texts["twolink.dynamics.robot"] += '\nmodule = f"twolink.parts.exchange.{name}"'
    assert {"twolink.dynamics.robot", "twolink.parts.exchange.c_code"} & set(first_circle(by_any_name(texts)))


@pytest.mark.some(1)
@pytest.mark.parametrize("form", ["{}", "if TYPE_CHECKING:\n    {}", "def late():\n    {}"])
def test_a_circle_that_is_put_in_is_reported(form: str) -> None:
    texts = sources()
    texts["twolink.robots.urdf"] += "\n" + form.format("from twolink.robots.load import load_model")
    circle = first_circle(imports(texts))
    assert {"twolink.robots.urdf", "twolink.robots.load"} <= set(circle)


def test_rooms_import_only_from_rooms_below() -> None:
    texts = sources()
    assert upward(imports(texts)) == []
    texts["twolink.io.text"] += "\nfrom twolink.dynamics import Robot"
    assert upward(imports(texts)) == [("twolink.io.text", "twolink.dynamics")]


def test_imported_libraries_are_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = [*project["dependencies"], *itertools.chain(*project["optional-dependencies"].values())]
    declared = {re.split(r"[^\w.-]", text)[0].lower().replace("_", "-") for text in wanted}
    provided = importlib.metadata.packages_distributions()
    provided["pinocchio"] = ["pin"]  # a cmeel wheel: its modules are beside site-packages' own
    provided["pydrake"] = ["drake"]  # of an extra that may be absent
    provided["coal"], provided["example_robot_data"] = ["coal"], ["example-robot-data"]
    undeclared: dict[str, str] = {}
    for module, text in sources().items():
        for name in imported_packages(text) - set(sys.stdlib_module_names) - {"twolink"}:
            names = {each.lower().replace("_", "-") for each in provided.get(name, [name])}
            if not names & declared:
                undeclared[name] = module
    assert undeclared == {}


def imported_packages(text: str) -> set[str]:
    """The packages that a file imports."""
    nodes = syntax(text).imports
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return {name.partition(".")[0] for name in plain | {str(n.module) for n in nodes if isinstance(n, ast.ImportFrom)}}


def rows_of(node: ast.expr | ast.stmt) -> range:
    """The lines of a node."""
    return range(node.lineno, (node.end_lineno or 0) + 1)


def code_lines(text: str) -> set[int]:
    """The lines with code: no docstrings, no comments, no blank lines, which within a longer string are code."""
    found = syntax(text)
    lines = {n for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")}
    for node in (*found.constants, *found.joined):
        if node.end_lineno != node.lineno:
            lines |= set(rows_of(node))
    for node in (*found.module, *found.classes, *found.functions):
        first = node.body[0] if node.body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            lines -= set(rows_of(first))
    return lines


def test_lines_of_code_leave_out_docstrings_comments_and_blank_lines() -> None:
    text = (
        '"""Module."""\n\n# comment\ndef f(\n    x: int,\n) -> int:\n    """Doc.\n\n    More.\n    """\n    return x\n'
    )
    assert code_lines(text) == {4, 5, 6, 11}


def test_files_and_functions_are_short() -> None:
    texts = {
        path: path.read_text("utf-8") for folder in ("twolink", "scripts") for path in (ROOT / folder).rglob("*.py")
    }
    lines = {path: code_lines(text) for path, text in texts.items()}
    assert {str(path): len(own) for path, own in lines.items() if len(own) > LONGEST_MODULE} == {}
    assert statistics.median(len(own) for path, own in lines.items() if path.name != "__init__.py") <= MEDIAN_MODULE
    long = {}
    for path, text in texts.items():
        for node in syntax(text).functions:
            size = len(lines[path] & set(rows_of(node)))
            if size > LONGEST_FUNCTION:
                long[f"{path.relative_to(ROOT)}: {node.name}"] = size
    assert long == {}


def classes(texts: Mapping[str, str]) -> dict[str, list[str]]:
    """The modules that define a class, by its name; private classes and those within others included."""
    modules: dict[str, list[str]] = {}
    for module, text in texts.items():
        for node in syntax(text).classes:
            modules.setdefault(node.name, []).append(module)
    return modules


def test_no_class_name_stands_twice() -> None:
    texts = sources()
    assert len(classes(texts)) > 300
    assert {name: modules for name, modules in classes(texts).items() if len(modules) > 1} == {}
    texts["twolink.io.text"] += "\nclass Robot: ..."
    assert classes(texts)["Robot"] == ["twolink.dynamics.robot", "twolink.io.text"]


NO_NOUN = {"What", "How", "Where", "Whether", "Those", "That", "When", "Who", "Which"}


def docstrings(text: str) -> list[str]:
    """The docstrings of a file."""
    found = syntax(text)
    nodes = (*found.module, *found.classes, *found.functions)
    return [docstring for node in nodes if (docstring := ast.get_docstring(node))]


def names_nothing(docstring: str) -> bool:
    """True if the first sentence begins with neither a noun phrase nor a verb."""
    return docstring.split()[0].rstrip(",") in NO_NOUN or docstring.startswith("The same ")


def test_docstrings_begin_with_a_noun_phrase_or_a_verb() -> None:
    every = {module: docstrings(text) for module, text in sources().items()}
    assert sum(map(len, every.values())) > 3000
    assert {module: bad for module, own in every.items() if (bad := [one for one in own if names_nothing(one)])} == {}
    assert names_nothing("Whether a < b.")


def test_every_file_that_the_page_names_exists() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    named = set(re.findall(r"`([\w/]+\.(?:pyi?|toml))`", page)) - EXAMPLES
    rooms = (
        "",
        "..",
        "dynamics",
        "integrate",
        "parts",
        "parts/identification",
        "parts/design",
    )  # of sections with short names
    missing = {name for name in named if not any((ROOT / "twolink" / room / name).exists() for room in rooms)}
    assert len(named) > 20
    assert missing == set()


def test_the_picture_shows_the_rooms_in_the_order_of_imports() -> None:
    picture = (ROOT / "docs" / "architecture.svg").read_text("utf-8")
    parts, rooms = (re.findall(r'class="room"[^>]*>(\w+)<', text)
                    for text in picture.split('id="parts"')[1].split('id="rooms"'))  # fmt: skip
    assert parts == layers("twolink.parts")
    doors, core = layers()[: layers().index("parts")], layers()[layers().index("parts") + 1 :]
    assert rooms == core
    folders = {path.parent.name for path in (ROOT / "twolink").glob("*/__init__.py")}
    assert {*rooms, *doors, "parts"} == folders | {"errors"} | {
        path.stem for path in (ROOT / "twolink").glob("[a-z]*.py")
    }
    assert set(parts) == {path.parent.name for path in (ROOT / "twolink" / "parts").glob("*/__init__.py")}


def test_the_page_prints_the_loop() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    source = textwrap.dedent(inspect.getsource(drive))
    printed = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "loop.tick" in block]
    assert len(printed) == 1
    assert textwrap.indent(printed[0], "    ") in source
