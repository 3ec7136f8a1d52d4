"""What `twolink.effects` holds, one line a name. A new effect needs its module and a line here."""

from twolink.effects.conditions import FrameReaches as FrameReaches
from twolink.effects.conditions import JointReaches as JointReaches
from twolink.effects.constants import Constants as Constants
from twolink.effects.constants import Gravity as Gravity
from twolink.effects.constants import Payload as Payload
from twolink.effects.constants import Rotor as Rotor
from twolink.effects.contact import Contact as Contact
from twolink.effects.contact import PlaneContact as PlaneContact
from twolink.effects.controllers import ComputedTorque as ComputedTorque
from twolink.effects.controllers import GravityCompensation as GravityCompensation
from twolink.effects.controllers import JointPD as JointPD
from twolink.effects.controllers import StateFeedback as StateFeedback
from twolink.effects.effect import Effect as Effect
from twolink.effects.forces import AirDrag as AirDrag
from twolink.effects.forces import FrameWrench as FrameWrench
from twolink.effects.forces import JointDamping as JointDamping
from twolink.effects.forces import JointSpring as JointSpring
from twolink.effects.forces import SmoothFriction as SmoothFriction
from twolink.effects.forces import SpringBetween as SpringBetween
from twolink.effects.forces import Torque as Torque
from twolink.effects.inputs import Bezier as Bezier
from twolink.effects.inputs import Polynomial as Polynomial
from twolink.effects.inputs import Sampled as Sampled
from twolink.effects.inputs import Sine as Sine
from twolink.effects.joint_switches import Detent as Detent
from twolink.effects.joint_switches import DryFriction as DryFriction
from twolink.effects.joint_switches import JointStops as JointStops
from twolink.effects.loops import Coupling as Coupling
from twolink.effects.loops import HingeLoop as HingeLoop
from twolink.effects.loops import PointLoop as PointLoop
from twolink.effects.loops import WeldLoop as WeldLoop
from twolink.effects.sampled_control import Controller as Controller
from twolink.effects.sensors import Encoder as Encoder
from twolink.effects.sensors import ForceTorque as ForceTorque
from twolink.effects.sensors import Imu as Imu
from twolink.effects.sensors import PoseSensor as PoseSensor
from twolink.effects.sensors import Tachometer as Tachometer
from twolink.effects.sensors import TorqueSensor as TorqueSensor
from twolink.effects.sensors import TouchSensor as TouchSensor
from twolink.effects.triggers import Engage as Engage
from twolink.effects.triggers import Release as Release
from twolink.effects.triggers import Watch as Watch
from twolink.geometry.pairs import Plane as Plane
from twolink.robots.collisions import Box as Box
from twolink.robots.collisions import Capsule as Capsule
from twolink.robots.collisions import Convex as Convex
from twolink.robots.collisions import Cylinder as Cylinder
from twolink.robots.collisions import Sphere as Sphere

TYPES: dict[str, str]

def effect_class(type_: str) -> type[Effect]: ...
