# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .chained_form import ChainedForm as ChainedForm
from .principles import ChaplyginReduction as ChaplyginReduction
from .principles import ReducedMotion as ReducedMotion
from .principles import ReducedTerms as ReducedTerms
from .principles import VakonomicMotion as VakonomicMotion
from .principles import vakonomic as vakonomic
from .steering import SteeringPlan as SteeringPlan
from .steering import steer_by_polynomials as steer_by_polynomials
from .steering import steer_by_sinusoids as steer_by_sinusoids
