"""The command that redraws the paper's figures and answers its claims."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

from typer import Option

from twolink.cli.options import Json
from twolink.cli.printing import show


def paper(out: Annotated[Path, Option(help="Folder of the figures.")] = Path("out"), as_json: Json = False) -> None:
    """Draw the paper's figures 6 to 13 and answer its claims.

    Each claim is answered with a number.
    """
    from twolink.paper.figures import study

    result = study(out)
    show(dataclasses.asdict(result), result.text(), as_json)
