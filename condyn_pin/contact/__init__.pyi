# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .cone import ConeRows as ConeRows
from .cone import Margin as Margin
from .friction_cone import FrictionCone as FrictionCone
from .scene_cones import cone_rows as cone_rows
from .scene_cones import margins as margins
from .wrench_cone import WrenchCone as WrenchCone
