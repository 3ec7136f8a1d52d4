"""docs/architecture.md and its picture name what there is."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = {"effects/my_effect.py", "hard/peers/my_peer.py", "scenes/bundled/my_scene.toml"}


def test_every_file_that_the_page_names_exists() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    named = set(re.findall(r"`([\w/]+\.(?:pyi?|toml))`", page)) - EXAMPLES
    rooms = ("", "dynamics", "integrate")  # the rooms of a section's short names
    missing = {name for name in named if not any((ROOT / "twolink" / room / name).exists() for room in rooms)}
    assert len(named) > 20
    assert missing == set()


def test_the_picture_shows_the_rooms_in_the_order_of_imports() -> None:
    picture = (ROOT / "docs" / "architecture.svg").read_text("utf-8")
    rooms = re.findall(r'class="room"[^>]*>(\w+)<', picture.split('id="rooms"')[1])
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    assert rooms == [layer.split(" ")[0] for layer in layers]
    folders = {path.parent.name for path in (ROOT / "twolink").glob("*/__init__.py")}
    assert set(rooms) == folders | {"errors"}
