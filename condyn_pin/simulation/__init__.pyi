# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .batch.answers import BatchDerivatives as BatchDerivatives
from .batch.answers import BatchSolution as BatchSolution
from .batch.answers import derivatives_batch as derivatives_batch
from .batch.answers import sample_batch as sample_batch
from .batch.answers import solve_batch as solve_batch
from .batch.motions import simulate_batch as simulate_batch
from .batch.trajectory import BatchTrajectory as BatchTrajectory
from .drift import DRIFTS as DRIFTS
from .drift import Drift as Drift
from .drift import NoDrift as NoDrift
from .drift import PostStabilization as PostStabilization
from .drift import Projection as Projection
from .events import Event as Event
from .events import Snapshot as Snapshot
from .events import Switch as Switch
from .events import switch as switch
from .integrators import INTEGRATORS as INTEGRATORS
from .integrators import Integrator as Integrator
from .integrators.contact_scheme import ContactScheme as ContactScheme
from .integrators.coordinate_partitioning import CoordinatePartitioning as CoordinatePartitioning
from .integrators.dormand_prince import DormandPrince as DormandPrince
from .integrators.explicit import ExplicitEuler as ExplicitEuler
from .integrators.explicit import Leapfrog as Leapfrog
from .integrators.explicit import RungeKutta4 as RungeKutta4
from .integrators.explicit import SemiImplicitEuler as SemiImplicitEuler
from .integrators.explicit import StormerVerlet as StormerVerlet
from .integrators.generalised_alpha import GeneralisedAlpha as GeneralisedAlpha
from .integrators.midpoint import ImplicitMidpoint as ImplicitMidpoint
from .integrators.midpoint import (
    LinearlyImplicitMidpoint as LinearlyImplicitMidpoint,
)
from .integrators.radau import GearGuptaLeimkuhler as GearGuptaLeimkuhler
from .integrators.radau import RadauIIA as RadauIIA
from .integrators.rattle import Rattle as Rattle
from .integrators.rattle import Shake as Shake
from .measures import Energy as Energy
from .motion_status import Effects as Effects
from .motion_status import MotionLimits as MotionLimits
from .motion_status import RunStatus as RunStatus
from .records import ContactRecord as ContactRecord
from .run import simulate as simulate
from .trajectory import MotionBalance as MotionBalance
from .trajectory import Trajectory as Trajectory
from .trajectory import motion_balance as motion_balance
