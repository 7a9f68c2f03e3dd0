# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .identification import Fit as Fit
from .identification import FitStatus as FitStatus
from .identification import fit as fit
from .logs import Log as Log
from .logs import PoseLog as PoseLog
from .logs import TorqueLog as TorqueLog
from .routes import ROUTES as ROUTES
from .routes import Route as Route
from .routes.active_set import ActiveSet as ActiveSet
from .routes.batch import BatchStepDerivatives as BatchStepDerivatives
from .routes.batch import step_derivatives_batch as step_derivatives_batch
from .routes.event_located import EventLocated as EventLocated
from .routes.kappa import Kappa as Kappa
from .routes.randomised import Randomised as Randomised
from .routes.softened import Softened as Softened
from .routes.step_derivatives import StepDerivatives as StepDerivatives
from .routes.trajectory_derivatives import TrajectoryDerivatives as TrajectoryDerivatives
from .routes.trajectory_derivatives import trajectory_derivatives as trajectory_derivatives
