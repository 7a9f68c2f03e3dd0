# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .cheapest import Choice as Choice
from .clocks import TimingEffort as TimingEffort
from .comparison import Comparison as Comparison
from .measures import MEASURES as MEASURES
from .measures.acceleration import AccelerationMeasure as AccelerationMeasure
from .measures.base import Measure as Measure
from .measures.contact import ContactMeasure as ContactMeasure
from .measures.derivatives import DerivativeMeasure as DerivativeMeasure
from .measures.forces import ForceMeasure as ForceMeasure
from .measures.gradients import GradientMeasure as GradientMeasure
from .measures.trajectory import TrajectoryMeasure as TrajectoryMeasure
from .mujoco.cross_check import CrossCheck as CrossCheck
from .mujoco.cross_check import TermCheck as TermCheck
from .mujoco.mujoco_bridge import MujocoBridge as MujocoBridge
from .row import Row as Row
from .scenes import modellings as modellings
from .states import GivenStates as GivenStates
from .states import NominalStates as NominalStates
from .states import PostureStates as PostureStates
from .states import SampledStates as SampledStates
from .study import Study as Study
from .sweeps import sweep as sweep
from .table import Table as Table
from .tuning import tune as tune
from .tuning import tuned as tuned
