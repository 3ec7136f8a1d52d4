"""The URDF of small robots, part by part."""


def link(name: str, mass: float = 1.0, moment: float = 1.0, at: str = "0 0 0") -> str:
    """A link of a mass, whose centre is somewhere, and whose three moments of inertia are equal."""
    moments = " ".join(f'{axis}="{moment}"' for axis in ("ixx", "iyy", "izz"))
    return (f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>'
            f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>')  # fmt: skip


def joint(name: str, kind: str, parent: str, child: str, axis: str, *, upper: float = 99.0, more: str = "") -> str:
    """A joint with wide limits."""
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
            f'<limit lower="-99" upper="{upper}" effort="1000" velocity="100"/>{more}</joint>')  # fmt: skip


def robot(*parts: str) -> str:
    """A robot that stands on the link `ground`."""
    return f'<robot name="r"><link name="ground"/>{"".join(parts)}</robot>'
