"""A measured motion of a human arm: torques of OpenSim's arm26 by twolink beside OpenSim's own; and of de Leva's arm.

    python -m scripts.studies.human_arm --folder FOLDER

The motion is an elbow flexion by markers (120 Hz, 1 s), which OpenSim's inverse kinematics made angles of. The folder
is the user's copy of Arm26/OutputReference of github.com/opensim-org/opensim-models at the commit before 7d78128, with
its folders InverseKinematics and InverseDynamics.

opensim: the arm of arm26.osim (Holzbaur et al. 2005), as a URDF: its torques less those of OpenSim's inverse dynamics,
of the same angles through an interpolating spline of degree 5, of them unfiltered, and by a Butterworth low pass of
order 3, 6 Hz, forth and back; without 0.1 s at each end, where splines and filters differ. by hand: de Leva's arm of
urdf/arm.urdf less Lagrange's equations of two links. de Leva: the same less OpenSim's, which is another man's arm.
Ends 0 if the first is below 1 % of the torques and the second below 1e-9 N m.
"""

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, filtfilt

import twolink as tl
from scripts.runner import Table, options

BODIES = {"r_humerus": "r_shoulder_elev", "r_ulna_radius_hand": "r_elbow_flex"}
GRAVITY, CUT = 9.8066, 12  # of arm26.osim, m/s^2; samples
ORDER, LOW_PASS = 3, 6.0  # Hz
AXES = ("xx", "yy", "zz", "xy", "xz", "yz")


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
    robot = tl.load_robot(f'<robot name="arm26"><link name="ground"/>{"".join(parts)}</robot>')
    return robot.with_gravity((0.0, -GRAVITY, 0.0))


def storage(path: Path) -> np.ndarray:
    """The numbers of a .mot or .sto file, angles in rad."""
    head, _, body = path.read_text().partition("endheader")
    table = np.array([line.split() for line in body.split("\n")[2:] if line.strip()], dtype=float)
    table[:, 1:] *= np.pi / 180 if "inDegrees=yes" in head else 1.0
    return table


def by_lagrange(robot: tl.Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """The torques of two links in a plane, hanging at q = 0."""
    (m1, c1, i1), (m2, c2, i2) = ((b.mass, -b.lever[2], b.inertia[1, 1]) for b in list(robot.model.inertias)[1:3])
    length, g = -robot.model.jointPlacements[2].translation[2], 9.81
    (w1, w2), (s1, s12) = v.T, (np.sin(q[:, 0]), np.sin(q.sum(axis=1)))
    near, far, both = i1 + m1 * c1**2 + m2 * length**2, i2 + m2 * c2**2, m2 * length * c2
    coupled, h = both * np.cos(q[:, 1]), both * np.sin(q[:, 1])
    elbow = (far + coupled) * a[:, 0] + far * a[:, 1] + h * w1**2 + m2 * g * c2 * s12
    shoulder = (near + far + 2 * coupled) * a[:, 0] + (far + coupled) * a[:, 1] - h * w2 * (2 * w1 + w2)
    return np.stack([shoulder + (m1 * c1 + m2 * length) * g * s1 + m2 * g * c2 * s12, elbow], axis=1)


def main() -> int:
    folder = Path(options(__doc__, folder="opensim").folder)
    robot, man = arm26(folder / "arm26.osim"), tl.load_robot("arm")
    motion = storage(folder / "InverseKinematics" / "arm26_InverseKinematics.mot")
    t, angles = motion[:, 0], motion[:, 1:]
    smooth = filtfilt(*butter(ORDER, LOW_PASS * 2 * (t[1] - t[0])), angles, axis=0)
    table, good = Table("way <28 | shoulder, N m >15.4g | elbow, N m >12.4g | % >8.3f"), True
    for name, q in (("Unfiltered", angles), ("Filtered", smooth)):
        theirs = storage(folder / "InverseDynamics" / f"{name}Results" / "arm26_InverseDynamics.sto")[:, 1:]
        spline = make_interp_spline(t, q, k=5)
        now = [spline.derivative(k)(t) if k else spline(t) for k in range(3)]
        leva = man.inverse_dynamics(*now)
        ways = {"opensim": robot.inverse_dynamics(*now) - theirs, "by hand": leva - by_lagrange(man, *now),
                "de Leva": leva - theirs}  # fmt: skip
        for way, left in ways.items():
            rms, size = (np.sqrt(np.mean(x[CUT:-CUT] ** 2, axis=0)) for x in (left, theirs))
            share = 100 * float(np.linalg.norm(rms) / np.linalg.norm(size))
            table.add(f"{way}, {name.lower()}", *rms, share)
            good = good and (way == "de Leva" or (share < 1.0 if way == "opensim" else rms.max() < 1e-9))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
