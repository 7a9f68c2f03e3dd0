# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .assembling_many import assemble_batch as assemble_batch
from .assembly import Assembly as Assembly
from .assembly import AssemblyStatus as AssemblyStatus
from .check import Check as Check
from .completion import CompleteState as CompleteState
from .completion import complete_state as complete_state
from .integrability import is_integrable as is_integrable
from .projection import project_acceleration as project_acceleration
from .projection import project_velocity as project_velocity
from .put_down import put_down as put_down
from .rank import Rank as Rank
from .reduction.fewer_rows import as_planar as as_planar
from .reduction.fewer_rows import merge_points as merge_points
from .reduction.linkages import without_linkage as without_linkage
from .reduction.minimal import minimal as minimal
from .reduction.minimal_report import Minimal as Minimal
from .reduction.minimal_report import ReductionStep as ReductionStep
from .reduction.price import ReductionErrors as ReductionErrors
from .reduction.reduced_scene import ReducedScene as ReducedScene
from .reduction.reduction import keep as keep
from .reduction.reduction import lock as lock
from .reduction.reduction import without as without
from .reduction.reduction import without_bodies as without_bodies
from .reduction.rods import rods_as_distances as rods_as_distances
from .sampling import sample as sample
from .summary import Summary as Summary
