"""What `twolink.effects` holds, one line a name. A new effect needs its module and a line here."""

from twolink.effects.air_drag import AirDrag as AirDrag
from twolink.effects.computed_torque import ComputedTorque as ComputedTorque
from twolink.effects.conditions import FrameReaches as FrameReaches
from twolink.effects.conditions import JointReaches as JointReaches
from twolink.effects.constants import Constants as Constants
from twolink.effects.contact import Contact as Contact
from twolink.effects.contact_pairs import Plane as Plane
from twolink.effects.coupling import Coupling as Coupling
from twolink.effects.detent import Detent as Detent
from twolink.effects.dry_friction import DryFriction as DryFriction
from twolink.effects.effect import Effect as Effect
from twolink.effects.engage import Engage as Engage
from twolink.effects.frame_wrench import FrameWrench as FrameWrench
from twolink.effects.gravity import Gravity as Gravity
from twolink.effects.gravity_compensation import GravityCompensation as GravityCompensation
from twolink.effects.hinge_loop import HingeLoop as HingeLoop
from twolink.effects.inputs import Bezier as Bezier
from twolink.effects.inputs import Polynomial as Polynomial
from twolink.effects.inputs import Sine as Sine
from twolink.effects.joint_damping import JointDamping as JointDamping
from twolink.effects.joint_pd import JointPD as JointPD
from twolink.effects.joint_spring import JointSpring as JointSpring
from twolink.effects.joint_stops import JointStops as JointStops
from twolink.effects.payload import Payload as Payload
from twolink.effects.plane_contact import PlaneContact as PlaneContact
from twolink.effects.point_loop import PointLoop as PointLoop
from twolink.effects.release import Release as Release
from twolink.effects.rotor import Rotor as Rotor
from twolink.effects.sampled import Sampled as Sampled
from twolink.effects.smooth_friction import SmoothFriction as SmoothFriction
from twolink.effects.spring_between import SpringBetween as SpringBetween
from twolink.effects.state_feedback import StateFeedback as StateFeedback
from twolink.effects.torque import Torque as Torque
from twolink.effects.watch import Watch as Watch
from twolink.effects.weld_loop import WeldLoop as WeldLoop
from twolink.robots.shapes import Box as Box
from twolink.robots.shapes import Capsule as Capsule
from twolink.robots.shapes import Convex as Convex
from twolink.robots.shapes import Cylinder as Cylinder
from twolink.robots.shapes import Sphere as Sphere

TYPES: dict[str, str]

def effect_class(type_: str) -> type[Effect]: ...
