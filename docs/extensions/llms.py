"""llms.txt: what the site has, a line a page, for programs that read it (llmstxt.org)."""

from pathlib import Path
from typing import Any

from docutils import nodes

LONGEST = 200  # characters of what is said of a page


def write(app: Any, failure: Exception | None) -> None:
    """Write the list beside the built pages."""
    if failure is not None or app.builder.format != "html":
        return
    env, summary = app.env, app.config.myst_html_meta["description lang=en"]
    lines = [f"# {app.config.project}", "", f"> {summary}", "", "## Pages", ""]
    for name in sorted(env.found_docs):
        first = next((one.astext() for one in env.get_doctree(name).findall(nodes.paragraph)), "")
        about = " ".join(first.split())
        about = about if len(about) <= LONGEST else about[:LONGEST].rsplit(" ", 1)[0] + " ..."
        link = f"- [{env.titles[name].astext()}]({app.builder.get_target_uri(name)})"
        lines.append(f"{link}: {about}" if about else link)
    (Path(app.outdir) / "llms.txt").write_text("\n".join(lines) + "\n", "utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Register the hook."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
