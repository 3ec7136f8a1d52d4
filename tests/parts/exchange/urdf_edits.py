"""Changes of a URDF: those that leave the robot what it is, and faults that converters and people make."""

import math
import random
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.robots.tree import canonical
from twolink.scenes.urdf_scene import urdf_tree

PRODUCTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def plain_urdf(name: str) -> ET.Element:
    """The URDF of a robot of the catalogue, without visuals."""
    return ET.fromstring(canonical(urdf_tree(tl.load_robot(name))))


def text(root: ET.Element) -> str:
    return ET.tostring(root, encoding="unicode")


def child(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    return ET.SubElement(element, tag) if found is None else found


def numbers(element: ET.Element | None, key: str) -> np.ndarray:
    return np.array([float(x) for x in ("0 0 0" if element is None else element.get(key, "0 0 0")).split()])


def written(values: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def tensor(inertial: ET.Element) -> np.ndarray:
    inertia = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (float(inertia.get(key)) for key in PRODUCTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def set_tensor(inertial: ET.Element, values: np.ndarray) -> None:
    for key, value in zip(PRODUCTS, values[np.triu_indices(3)], strict=True):
        inertial.find("inertia").set(key, repr(float(value)))


def turned_inertia(root: ET.Element, rng: random.Random) -> None:
    """Every inertia along other axes, with their rotation in <origin rpy>."""
    for inertial in root.iter("inertial"):
        origin = child(inertial, "origin")
        old = pin.rpy.rpyToMatrix(*numbers(origin, "rpy"))
        angles = [rng.uniform(-1.4, 1.4) for _ in range(3)]
        new = pin.rpy.rpyToMatrix(*angles)
        set_tensor(inertial, new.T @ old @ tensor(inertial) @ old.T @ new)
        origin.set("rpy", written(angles))


def shuffled(root: ET.Element, rng: random.Random) -> None:
    """Links and joints in another order."""
    children = list(root)
    rng.shuffle(children)
    root[:] = children


def renamed_links(root: ET.Element, rng: random.Random) -> None:
    prefix = f"k{rng.randrange(100)}_"
    for element in root.iter():
        if element.tag == "link" and "name" in element.attrib:
            element.set("name", prefix + element.get("name"))
        if element.tag in ("parent", "child"):
            element.set("link", prefix + element.get("link"))


def renamed_joints(root: ET.Element, _: random.Random) -> None:
    for element in root.iter():
        if element.tag == "joint":
            element.set("name", element.get("name") + "_x")
        if element.tag == "mimic":
            element.set("joint", element.get("joint") + "_x")


def split_links(root: ET.Element, rng: random.Random) -> None:
    """The inertia of a link moves to a new link that is fixed to it, elsewhere and turned."""
    for link in list(root.findall("link"))[::3]:
        inertial = link.find("inertial")
        if inertial is None:
            continue
        name = link.get("name") + "_part"
        place = pin.SE3(pin.rpy.rpyToMatrix(*(rng.uniform(-1, 1) for _ in range(3))), np.array([0.1, -0.2, 0.05]))
        part, joint = ET.SubElement(root, "link", name=name), ET.SubElement(root, "joint", name=name, type="fixed")
        ET.SubElement(joint, "parent", link=link.get("name"))
        ET.SubElement(joint, "child", link=name)
        ET.SubElement(joint, "origin", xyz=written(place.translation),
                      rpy=written(pin.rpy.matrixToRpy(place.rotation)))  # fmt: skip
        origin = child(inertial, "origin")
        frame = pin.SE3(pin.rpy.rpyToMatrix(*numbers(origin, "rpy")), numbers(origin, "xyz"))
        moved = place.inverse() * frame
        origin.set("xyz", written(moved.translation))
        origin.set("rpy", written(pin.rpy.matrixToRpy(moved.rotation)))
        link.remove(inertial)
        part.append(inertial)


def fewer_digits(root: ET.Element, _: random.Random) -> None:
    for element in root.iter():
        for key, value in element.attrib.items():
            if element.tag in ("mass", "inertia") or key == "xyz":
                element.set(key, " ".join(f"{float(x):.10g}" for x in value.split()))


RIGHT: tuple[Callable[[ET.Element, random.Random], None], ...] = (
    turned_inertia, shuffled, renamed_links, renamed_joints, split_links, fewer_digits,
)  # fmt: skip


def _link(root: ET.Element, k: int) -> ET.Element:
    """A link that moves and has an inertia without symmetry."""
    moved = {joint.find("child").get("link") for joint in root.iter("joint") if joint.get("type") != "fixed"}
    links = [e for e in root.iter("link") if e.get("name") in moved and e.find("inertial") is not None]
    return links[k % len(links)]


def _joint(root: ET.Element, k: int, *types: str) -> ET.Element:
    joints = [e for e in root.iter("joint") if e.get("type") in (types or ("revolute",))]
    return joints[k % len(joints)]


def faults(k: int) -> dict[str, tuple[Callable[[ET.Element], str], str, str]]:
    """Faults by name: what makes it and returns the link or joint at fault, what differs, words of the cause."""

    def inertial(change: Callable[[ET.Element], None]) -> Callable[[ET.Element], str]:
        def make(root: ET.Element) -> str:
            link = _link(root, k)
            change(link.find("inertial"))
            return link.get("name")

        return make

    def joint(change: Callable[[ET.Element], None]) -> Callable[[ET.Element], str]:
        def make(root: ET.Element) -> str:
            element = _joint(root, k)
            change(element)
            return element.get("name")

        return make

    def put(tag: str, **values: str) -> Callable[[ET.Element], None]:
        return lambda element: child(element, tag).attrib.update(values)

    def times(tag: str, factor: float, *keys: str) -> Callable[[ET.Element], None]:
        def change(element: ET.Element) -> None:
            for key in keys:
                part = element.find(tag)
                part.set(key, written(factor * np.array([float(x) for x in part.get(key).split()])))

        return change

    def about_origin(element: ET.Element) -> None:
        c, m = numbers(element.find("origin"), "xyz"), float(element.find("mass").get("value"))
        turn = pin.rpy.rpyToMatrix(*numbers(element.find("origin"), "rpy"))
        set_tensor(element, tensor(element) + turn.T @ (m * (c @ c * np.eye(3) - np.outer(c, c))) @ turn)

    def other_order(element: ET.Element) -> None:
        i = element.find("inertia")
        values = [i.get(key) for key in PRODUCTS]
        for key, value in zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), values, strict=True):
            i.set(key, value)

    def turned(element: ET.Element) -> None:
        origin = child(element, "origin")
        place = pin.rpy.rpyToMatrix(*numbers(origin, "rpy"))
        axis = numbers(element.find("axis"), "xyz")
        origin.set("rpy", written(pin.rpy.matrixToRpy(place @ pin.exp3(0.3 * axis))))

    def swapped_axis(element: ET.Element) -> None:
        axis = child(element, "axis")
        axis.set("xyz", written(np.roll(numbers(axis, "xyz"), 1)))

    def moved(tag: str, by: float) -> Callable[[ET.Element], None]:
        def change(element: ET.Element) -> None:
            origin = child(element, tag)
            origin.set("xyz", written(numbers(origin, "xyz") + np.array([0.3 * by, by, 0.5 * by])))

        return change

    return {
        "inertia rotation dropped": (inertial(put("origin", rpy="0 0 0")), "inertia", "rotation of the inertia"),
        "sign of ixy": (inertial(times("inertia", -1.0, "ixy")), "inertia", "sign of ixy"),
        "sign of iyz": (inertial(times("inertia", -1.0, "iyz")), "inertia", "sign of iyz"),
        "inertia about the origin": (inertial(about_origin), "inertia", "about the link's origin"),
        "inertia in g mm^2": (inertial(times("inertia", 1e9, *PRODUCTS)), "inertia", "scaled by 1e+09"),
        "entries in another order": (inertial(other_order), "inertia", "another order"),
        "products dropped": (inertial(put("inertia", ixy="0", ixz="0", iyz="0")), "inertia", "products of inertia"),
        "mass scaled": (inertial(times("mass", 1.1, "value")), "mass", "scaled by 1.1"),
        "centre dropped": (inertial(put("origin", xyz="0 0 0")), "centre of mass", "left out"),
        "centre moved": (inertial(moved("origin", 0.02)), "centre of mass", "moved by 0.0231"),
        "centre in mm": (inertial(times("origin", 1e3, "xyz")), "centre of mass", "millimetres"),
        "damping dropped": (joint(put("dynamics", damping="0")), "damping", "left out"),
        "friction dropped": (joint(put("dynamics", friction="0")), "friction", "left out"),
        "limits in degrees": (joint(times("limit", 180 / math.pi, "lower", "upper")), "upper limit", "degrees"),
        "effort limit dropped": (joint(put("limit", effort="0")), "effort limit", "left out"),
        "velocity limit changed": (joint(times("limit", 2.0, "velocity")), "velocity limit", "another number"),
        "axis flipped": (joint(times("axis", -1.0, "xyz")), "axis", "other way"),
        "another axis": (joint(swapped_axis), "axis", "turned by 1.571"),
        "zero offset": (joint(turned), "zero", "zero is displaced"),
        "origin moved": (joint(moved("origin", 0.03)), "origin", "displaced"),
        "joint fixed": (joint(lambda element: element.set("type", "fixed")), "joint", "fixed in"),
    }
