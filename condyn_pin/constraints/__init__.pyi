# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .applied_force import AppliedForce as AppliedForce
from .baumgarte import Baumgarte as Baumgarte
from .constraints import Constraint as Constraint
from .constraints import Coupling as Coupling
from .constraints import Loop as Loop
from .contacts import LineContact as LineContact
from .contacts import PlanarContact as PlanarContact
from .contacts import PointContact as PointContact
from .contacts import SurfaceContact as SurfaceContact
from .nonholonomic import KnifeEdge as KnifeEdge
from .nonholonomic import RollingBall as RollingBall
from .nonholonomic import RollingWheel as RollingWheel
from .rows.terms import Terms as Terms
from .violation import ConstraintViolation as ConstraintViolation
