"""A measured motion of a human arm: torques of OpenSim's arm26 by twolink beside OpenSim's own; and of de Leva's arm.

    python -m scripts.studies.human_arm --folder FOLDER

The motion is an elbow flexion by markers (120 Hz, 1 s), of which OpenSim's inverse kinematics made angles. The folder
is the user's copy of Arm26/OutputReference of github.com/opensim-org/opensim-models at the commit before 7d78128.

opensim: the arm of arm26.osim (Holzbaur et al. 2005): its torques less those of OpenSim's inverse dynamics, of the same
angles through an interpolating spline of degree 5; without 0.1 s at each end, where splines differ. de Leva: those of
urdf/arm.urdf less OpenSim's: another man's arm. Ends 0 if the first is below 0.01 % of the torques.
"""

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.interpolate import make_interp_spline

import twolink as tl
from scripts.runner import Table, options

BODIES = {"r_humerus": "r_shoulder_elev", "r_ulna_radius_hand": "r_elbow_flex"}
AXES = ("xx", "yy", "zz", "xy", "xz", "yz")
GRAVITY, CUT, SHARE = (0.0, -9.8066, 0.0), 12, 1e-4  # of arm26.osim, m/s^2; samples


def arm26(path: Path) -> tl.Robot:
    """The arm of the .osim file."""
    parts, parent = [], "ground"
    for body in ElementTree.parse(path).getroot().iter("Body"):
        if (name := body.get("name")) in BODIES:
            moments = " ".join(f'i{axes}="{body.findtext(f"inertia_{axes}")}"' for axes in AXES)
            joint = next(body.iter("CustomJoint"))
            axis = next(one for one in joint.iter("TransformAxis") if (one.findtext("coordinates") or "").strip())
            place = joint.findtext("location_in_parent")
            parts.append(f'<link name="{name}"><inertial><origin xyz="{body.findtext("mass_center")}"/>'
                         f'<mass value="{body.findtext("mass")}"/><inertia {moments}/></inertial></link>'
                         f'<joint name="{BODIES[name]}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
                         f'<limit lower="-3" upper="3" effort="0" velocity="0"/><origin xyz="{place}"/>'
                         f'<axis xyz="{axis.findtext("axis")}"/></joint>')  # fmt: skip
            parent = name
    return tl.load_robot(f'<robot name="arm26"><link name="ground"/>{"".join(parts)}</robot>').with_gravity(GRAVITY)


def numbers_in(path: Path) -> np.ndarray:
    """The numbers of a .mot or .sto file."""
    rows = path.read_text().partition("endheader")[2].split("\n")[2:]
    return np.array([row.split() for row in rows if row.strip()], dtype=float)


def main() -> int:
    folder = Path(options(__doc__, folder="opensim").folder)
    t, *angles = numbers_in(folder / "InverseKinematics" / "arm26_InverseKinematics.mot").T
    theirs = numbers_in(folder / "InverseDynamics" / "UnfilteredResults" / "arm26_InverseDynamics.sto")[:, 1:]
    spline = make_interp_spline(t, np.radians(angles).T, k=5)
    now = [spline(t), *(spline.derivative(k)(t) for k in (1, 2))]
    table, shares = Table("way <10 | shoulder, N m >15.4g | elbow, N m >12.4g | % >8.3g"), []
    for way, robot in (("opensim", arm26(folder / "arm26.osim")), ("de Leva", tl.load_robot("arm"))):
        left = robot.inverse_dynamics(*now) - theirs
        rms, size = (np.sqrt(np.mean(x[CUT:-CUT] ** 2, axis=0)) for x in (left, theirs))
        shares.append(float(np.linalg.norm(rms) / np.linalg.norm(size)))
        table.add(way, *rms, 100 * shares[-1])
    return 0 if shares[0] < SHARE else 1


if __name__ == "__main__":
    sys.exit(main())
