# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .case import TimingEffort as TimingEffort
from .fresh import Choice as Choice
from .measures import MEASURES as MEASURES
from .measures.answers import AccelerationMeasure as AccelerationMeasure
from .measures.answers import DerivativeMeasure as DerivativeMeasure
from .measures.answers import ForceMeasure as ForceMeasure
from .measures.measure import Measure as Measure
from .measures.motions import ContactMeasure as ContactMeasure
from .measures.motions import GradientMeasure as GradientMeasure
from .measures.motions import TrajectoryMeasure as TrajectoryMeasure
from .mujoco.bridge import MujocoBridge as MujocoBridge
from .mujoco.compare import CrossCheck as CrossCheck
from .mujoco.compare import TermCheck as TermCheck
from .states import GivenStates as GivenStates
from .states import NominalStates as NominalStates
from .states import PostureStates as PostureStates
from .states import SampledStates as SampledStates
from .states import modellings as modellings
from .study import Study as Study
from .study import sweep as sweep
from .study import tune as tune
from .study import tuned as tuned
from .table import Comparison as Comparison
from .table import Table as Table
from .tables import Row as Row
