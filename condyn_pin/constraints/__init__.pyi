# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .applied_force import AppliedForce as AppliedForce
from .base import Constraint as Constraint
from .baumgarte import Baumgarte as Baumgarte
from .contacts.base import Contact as Contact
from .contacts.convex import Convex as Convex
from .contacts.frictional_contact import FrictionalContact as FrictionalContact
from .contacts.joint_friction import JointFriction as JointFriction
from .contacts.joint_limit import JointLimit as JointLimit
from .contacts.plane import Plane as Plane
from .contacts.shapes import Ball as Ball
from .contacts.shapes import Box as Box
from .contacts.shapes import Capsule as Capsule
from .contacts.shapes import Point as Point
from .coupling import Coupling as Coupling
from .knife_edge import KnifeEdge as KnifeEdge
from .line_contact import LineContact as LineContact
from .loop import Loop as Loop
from .planar_contact import PlanarContact as PlanarContact
from .point_contact import PointContact as PointContact
from .rolling_ball import RollingBall as RollingBall
from .rolling_wheel import RollingWheel as RollingWheel
from .rows.terms import Terms as Terms
from .surface_contact import SurfaceContact as SurfaceContact
from .violation import ConstraintViolation as ConstraintViolation
