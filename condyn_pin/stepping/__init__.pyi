# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .batch import BatchStep as BatchStep
from .batch import step_batch as step_batch
from .schemes.anitescu import Anitescu as Anitescu
from .schemes.event_driven import EventDriven as EventDriven
from .schemes.moreau import Moreau as Moreau
from .schemes.soft_step import SoftStep as SoftStep
from .schemes.stewart_trinkle import StewartTrinkle as StewartTrinkle
from .single_step import StepSolution as StepSolution
from .single_step import contact_problem as contact_problem
from .single_step import step as step
