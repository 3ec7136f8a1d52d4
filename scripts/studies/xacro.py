"""Every robot that is a xacro below some folders loads, without ROS, or is refused by name.

    python -m scripts.studies.xacro FOLDER... [--arguments NAME=VALUE,...]

Packages are looked for in the folders. Files that define macros alone have no links, and are refused so.
"""

from pathlib import Path

import twolink as tl
from scripts.runner import options
from twolink.errors import TwolinkError


def main() -> None:
    """Print a line a file."""
    given = options(__doc__, arguments="", rest=(".",))
    arguments = dict(pair.split("=", 1) for pair in given.arguments.split(",") if pair)
    for path in sorted(p for folder in given.rest for p in Path(folder).rglob("*.urdf.xacro")):
        try:
            robot = tl.load_robot(path, package_dirs=given.rest, xacro_arguments=arguments)
            print(f"loaded  {path}: nv = {robot.nv}, {robot.mass:.6g} kg")
        except TwolinkError as error:
            print(f"refused {path}: {error}")


if __name__ == "__main__":
    main()
