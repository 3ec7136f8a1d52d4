"""Pages that are made from the code before a build: catalogues, commands, and the Python reference."""

import inspect
import re
import textwrap
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

import method_pictures
import typer
from gallery import picture

import twolink as tl
from twolink.cli.app import app as command_line
from twolink.effects.loops import Loop
from twolink.effects.switching import SwitchingEffect
from twolink.hard import SimulationCase, all_cases
from twolink.io.text import Table, kebab_case

FOLDER = "generated"
SHOWN = 3  # pictures of an effect
ROOMS = {  # the order and the titles of the reference's pages, by the room that a name comes from
    "dynamics": "Robots and queries",
    "robots": "Robots and queries",
    "lint": "Robots and queries",
    "scenes": "Scenes",
    "effects": "Scenes",
    "simulation": "Simulation",
    "accuracy": "Accuracy and methods",
    "integrate": "Accuracy and methods",
    "io": "Simulation",
    "identification": "Identification",
    "lagrange": "The paper's arm",
    "service": "The service's client",
}


def cell(value: Any) -> str:
    """A table's cell."""
    text = ", ".join(map(str, value)) if isinstance(value, tuple | list) else "" if value is None else str(value)
    return " ".join(text.replace("|", "\\|").split())


def markdown(table: Table) -> str:
    """A table in Markdown."""
    rows = [table.columns, ["---"] * len(table.columns), *table.rows]
    return "\n".join(f"| {' | '.join(map(cell, row))} |" for row in rows)


def page(title: str, *parts: str) -> str:
    return "\n\n".join([f"# {title}", *parts]) + "\n"


def autodoc(directive: str, name: str, *options: str) -> str:
    """A directive of autodoc."""
    return "\n".join(["```{eval-rst}", f".. {directive}:: {name}", *(f"   :{option}:" for option in options), "```"])


def shown_in(app: Any) -> dict[str, str]:
    """Pictures of the scenes with each effect, by the effect's type."""
    found: dict[str, list[str]] = {}
    for scene in tl.scenes():
        for kind in dict.fromkeys(scene["effects"]):
            found.setdefault(kind, []).append(picture(app, str(scene["name"]), f"{scene['name']}: {scene['title']}"))
    return {kind: "".join(pictures[:SHOWN]) for kind, pictures in found.items()}


def effects(app: Any) -> str:
    """The catalogue of effects, by what they do."""
    pictures = shown_in(app)
    groups: dict[str, list[str]] = {
        "Forces, controllers and changes of the robot": [],
        "Events": [],
        "Loops": [],
        "Inputs and conditions": [],
    }
    smooth, events, loops, inputs = groups.values()
    for name in dir(tl.effects):
        kind = getattr(tl.effects, name)
        if kind is not tl.effects.Effect:
            switching, loop = issubclass(kind, SwitchingEffect), issubclass(kind, Loop)
            group = (
                events if switching else loops if loop else smooth if issubclass(kind, tl.effects.Effect) else inputs
            )
            entry = autodoc("autoclass", f"twolink.effects.{name}")
            group.append(f"### {name}\n\n{entry}\n\n{pictures.get(kebab_case(name), '')}")
    about = (
        "A scene calls for each of these by name; what is not in its list does not exist for it. `twolink explain` "
        "counts the operations of each. In Python they are `tl.effects.NAME(...)`; in a scene file `type` is the name "
        "in lower case with hyphens. [Write your own](../tutorials/own_effect.md) where none fits."
    )
    return page("Effects", about, *("\n\n".join([f"## {title}", *entries]) for title, entries in groups.items()))


def methods(app: Any) -> str:
    """The catalogue of methods, each with a picture of what accuracy costs by it."""
    about = (
        '`method="auto"`, the default, takes the cheapest for the accuracy that is asked for. The coefficients are in '
        "`twolink/integrate/steps/methods.toml`, and the tests prove the order of each method by its order conditions."
    )
    parts = [
        f"## {m['name']}\n\n{cell(m['good_for']).capitalize()}.\n\n{method_pictures.picture(app, str(m['name']))}"
        for m in tl.methods()
    ]
    if "<img" in parts[-1]:
        parts.insert(0, method_pictures.ABOUT)
    return page("Methods", about, markdown(tl.methods()), *parts)


def scenes(app: Any) -> str:
    """The catalogue of bundled scenes, each with its file."""
    parts = [
        "`tl.load_scene(NAME)` loads one, `twolink run NAME` runs it, and the [gallery](../gallery.md) plays them all."
    ]
    parts.append(markdown(tl.scenes()))
    folder = resources.files("twolink.scenes") / "bundled"
    for scene in tl.scenes():
        text = (folder / f"{scene['name']}.toml").read_text("utf-8")
        shown = picture(app, str(scene["name"]), str(scene["title"]))
        parts.append(f"## {scene['name']}\n\n{cell(scene['title'])}.\n\n{shown}\n\n```toml\n{text}```")
    return page("Scenes", *parts)


def hard_cases(app: Any) -> str:
    """The catalogue of hard cases."""
    parts = [
        "What breaks simulators, with the exact answer of each case. `twolink hard-cases NAME` runs one and judges it; "
        "`--peers` adds SciPy, MuJoCo and Drake where they can do it, `--html` writes one page with curves."
    ]
    for group, cases in groupby(all_cases(), key=lambda case: case.group):
        parts.append(f"## {group.capitalize()}")
        for case in cases:
            facts = [f"- Truth: {cell(case.truth)}."]
            if isinstance(case, SimulationCase):
                facts.append(f"- Compared: {cell(case.quantity)}, for {case.duration or case.load().duration:g} s.")
            about = f"**{cell(case.title)}.** {cell(case.why)}"
            shown = picture(app, f"case-{case.name}", case.title)
            parts.append("\n\n".join([f"### {case.name}", about, shown, "\n".join(facts)]))
    return page("Hard cases", *parts)


def commands() -> str:
    """The commands, with their arguments and options."""
    parts = [
        cell(str(command_line.info.epilog)),
        "Every command has `--help` and `-h`, most have `--json`; errors are one line on stderr.",
    ]
    group = typer.main.get_command(command_line)
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        rows = []
        for each in command.params:
            option = each.param_type_name == "option"
            names = " ".join(f"`{text}`" for text in each.opts) if option else f"`{str(each.name).upper()}`"
            rows.append((names, getattr(each, "help", None) or ""))
        paragraphs = inspect.cleandoc(command.help or "").split("\n\n")
        texts = [f"```text\n{t[1:].strip()}\n```" if t.startswith("\b") else t for t in paragraphs]  # \b: as it is
        parts += [f"## twolink {name}", *texts]
        if rows:
            parts.append(markdown(Table(("option", "what it does"), tuple(rows))))
    return page("Command line", *parts)


SIDE_BY_SIDE = ("explain", "simulate", "simulate_many", "sensitivities", "gradient", "optimize", "sweep",
                "accuracy_study", "fit")  # fmt: skip


def signatures() -> str:
    """The arguments of all that runs scenes, side by side; and the public names."""
    given = {name: inspect.signature(getattr(tl, name)).parameters for name in SIDE_BY_SIDE}
    names = list(dict.fromkeys(argument for one in given.values() for argument in one))
    common = sorted(names, key=lambda argument: -sum(argument in one for one in given.values()))

    def default(argument: inspect.Parameter | None) -> str:
        if argument is None:
            return ""
        return "needed" if argument.default is argument.empty else f"`{argument.default!r}`"

    rows = tuple((f"`{argument}`", *(default(one.get(argument)) for one in given.values())) for argument in common)
    about = (
        "One argument means the same wherever it is. The scene and the duration may be given by place, in that order, "
        "all others by name. A cell has the default; an empty one: there is no such argument. `fit` has the times of "
        "its measurements in place of a duration."
    )
    listed = ", ".join(f"`tl.{name}`" for name in dir(tl))
    progress = (
        "`progress` is called now and then with what is done, the total and a label: simulated seconds, simulations, "
        "runs or pictures. `tl.progress_bar()` gives one that fits all."
    )
    results = (
        "Every result has `text()`, `summary` (one line), `to_dict()` (plain data for JSON), `save(path)`, `plot()` "
        "and a view in notebooks."
    )
    return page("Arguments side by side", about, markdown(Table(("argument", *SIDE_BY_SIDE), rows)), progress, results,
                f"## Public names\n\n{listed}")  # fmt: skip


def reference() -> dict[str, str]:
    """The pages of the Python reference, by their names: all public names, by the room they come from."""
    titles = list(dict.fromkeys(ROOMS.values()))
    entries: dict[str, list[str]] = {title: [] for title in titles}
    for name in tl.__all__:
        thing = getattr(tl, name)
        if inspect.ismodule(thing):
            continue
        room = thing.__module__.removeprefix("twolink.").removeprefix("parts.").split(".")[0]
        title = ROOMS.get(room, room.capitalize())
        kind = "autoclass" if inspect.isclass(thing) else "autofunction"
        options = ("members", "inherited-members: Struct, object") if kind == "autoclass" else ()
        entries.setdefault(title, []).append(f"## {name}\n\n{autodoc(kind, f'twolink.{name}', *options)}")
    entries["The paper's arm"].append("## lagrange.two_link\n\n" + autodoc("autofunction", "twolink.lagrange.two_link"))
    entries["The paper's arm"].append(
        "## lagrange.TwoLink\n\n" + autodoc("autoclass", "twolink.lagrange.TwoLink", "members")
    )
    entries["Scenes"].append(
        "## effects.Effect\n\nThe base of effects of your own; see [the tutorial](../tutorials/own_effect.md).\n\n"
        + autodoc("autoclass", "twolink.effects.Effect", "members", "exclude-members: __init__")
    )
    tree = "```\n" + textwrap.dedent(tl.errors.__doc__ or "") + "```"
    kinds = [name for name, kind in vars(tl.errors).items() if isinstance(kind, type) and issubclass(kind, Exception)]
    register = Table(("code", "when", "what to do"), tuple((f"`{c}`", *row) for c, row in tl.errors.codes().items()))
    entries["Errors"] = [tree, *(autodoc("autoexception", f"twolink.errors.{name}") for name in kinds), "## Codes",
                         autodoc("autofunction", "twolink.errors.codes"), markdown(register)]  # fmt: skip
    return {
        f"api_{re.sub('[^a-z]+', '_', title.lower())}": page(title, *parts) for title, parts in entries.items() if parts
    }


def write(app: Any) -> None:
    """Write all pages into docs/generated; what did not change stays, so that Sphinx does not read it again."""
    pages = {"effects": effects(app), "methods": methods(app), "scenes": scenes(app),
             "hard_cases": hard_cases(app), "command_line": commands(), "signatures": signatures(),
             **reference()}  # fmt: skip
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        file = folder / f"{name}.md"
        if not file.exists() or file.read_text("utf-8") != text:
            file.write_text(text, "utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Register the writing of the pages."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
