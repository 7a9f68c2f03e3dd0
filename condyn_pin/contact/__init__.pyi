# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .cones.friction_cone import FrictionCone as FrictionCone
from .cones.margin import ConeRows as ConeRows
from .cones.margin import Margin as Margin
from .cones.verbs import cone_rows as cone_rows
from .cones.verbs import margins as margins
from .cones.wrench_cone import WrenchCone as WrenchCone
