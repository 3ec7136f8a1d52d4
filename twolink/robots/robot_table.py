"""The table of robots known by name."""

import functools

from twolink.errors import RobotError
from twolink.io.listing import Table
from twolink.robots.catalogue import catalogue_entry, catalogue_names
from twolink.robots.load import load_model
from twolink.robots.model import RobotModel

COLUMNS = ("name", "from", "root", "nq", "nv", "mass", "refused")


@functools.cache
def robots() -> Table:
    """The robots that `load_robot` knows by name. Each is loaded once, some seconds in all.

    Returns
    -------
    Table
        Columns name, from (the package it comes from), root (the one it is meant to have), nq and nv with that root,
        mass [kg], and refused (why it cannot be loaded).
    """
    rows: list[tuple[object, ...]] = []
    for name in catalogue_names():
        entry = catalogue_entry(name)
        try:
            robot = load_model(RobotModel, name, root=entry.usual_root)
            rows.append((name, entry.origin, entry.usual_root, robot.nq, robot.nv, robot.mass, None))
        except RobotError as error:
            rows.append((name, entry.origin, entry.usual_root, None, None, None, str(error)))
    return Table(COLUMNS, tuple(rows))
