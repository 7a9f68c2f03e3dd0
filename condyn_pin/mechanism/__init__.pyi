# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .assembly import Assembly as Assembly
from .assembly import AssemblyStatus as AssemblyStatus
from .check import Check as Check
from .completion import CompleteState as CompleteState
from .integrability import is_integrable as is_integrable
from .rank import Rank as Rank
from .reduction.minimal_report import Minimal as Minimal
from .reduction.minimal_report import ReductionStep as ReductionStep
from .reduction.price import ReductionErrors as ReductionErrors
from .reduction.reduced_scene import ReducedScene as ReducedScene
from .summary import Summary as Summary
