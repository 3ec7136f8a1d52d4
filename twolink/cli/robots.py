"""The commands about robots: list those known by name, and inspect one."""

from textwrap import shorten
from typing import Annotated, Any

from typer import Option

from twolink.cli.options import Folders, Gravity, Json, Lock, Mimic, RobotName, Root, Unphysical, robot_from
from twolink.cli.output import show
from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_record
from twolink.errors import RobotError
from twolink.io.listing import Table
from twolink.robots import robots as robot_table


def robots(as_json: Json = False) -> None:
    """List the robots known by name, with their sizes and masses.

    Each line has nq, nv, the mass in kg, the root the robot is meant to have (fixed to the world, or a floating base)
    and where it comes from. A robot that is refused is listed with the reason.
    """
    table = robot_table()
    records = [{name: value for name, value in record.items() if value is not None} for record in table]
    refused = [
        f"{record['name']} is refused (`twolink inspect {record['name']}` says all): {shorten(record['refused'], 120)}"
        for record in records
        if "refused" in record
    ]
    text = table.select("name", "nq", "nv", "mass", "root", "from")
    show(records, "\n".join([str(text), *refused]), as_json)


def inspect(
    robot: RobotName,
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = "0 0 -9.81",
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    package_dirs: Folders = None,
    cross_check: Annotated[bool, Option("--cross-check", help="Compare with yourdfpy's reading.")] = False,
    as_json: Json = False,
) -> None:
    """Say what a URDF holds: joints, masses, the load report.

    The load report lists what was read, ignored, repaired and assumed. The exit code is 1 when --cross-check finds
    another robot.
    """
    loaded = robot_from(robot, root, lock, gravity, mimic, unphysical, package_dirs)
    record = robot_record(loaded)
    text = _text(loaded, record)
    if cross_check:
        from twolink.robots.cross_check import compare

        record["second_reading"] = compare(loaded)
        text += f"\n\nsecond reading (yourdfpy): {record['second_reading']['text']}"
    show(record, text, as_json)
    if cross_check and not record["second_reading"]["agree"]:
        remedy = "trust neither, and report it with the URDF"
        raise RobotError("Pinocchio and yourdfpy read it differently", where=f"robot {loaded.name!r}", remedy=remedy)


def _text(robot: Robot, record: dict[str, Any]) -> str:
    """Joints, the load report, and how batches are answered."""
    rows = [(j["name"], j["kind"], _entries(*j["q"]), _entries(*j["v"]), j["mass"]) for j in record["joints"]]
    joints = Table(("joint", "kind", "q", "v", "kg moved with it"), tuple(rows))
    sizes = f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {robot.mass:.6g} kg moving"
    return f"{sizes}\n\n{joints}\n\n{robot.report}\n\nbatches: {_engines(robot)}"


def _entries(start: int, stop: int) -> str:
    """The entries of a joint in q or v: 3, 3:7, or - where there are none."""
    return "-" if start == stop else str(start) if stop == start + 1 else f"{start}:{stop}"


def _engines(robot: Robot) -> str:
    """How batches of queries are answered on this machine."""
    from twolink.dynamics.kernels import heyoka

    module = heyoka()
    if module is None:
        return "by Pinocchio alone; heyoka, which compiles them, is not installed here"
    if robot.has_mimic:
        return "by Pinocchio alone; mimic joints are not compiled"
    return f"compiled by heyoka {module.__version__} where that is faster, certified against Pinocchio"
