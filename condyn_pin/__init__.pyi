# What a user meets first, and the file that has it; `__init__.py` reads this file.
# Everything else that is public is in the stub of its room.

from . import constraints as constraints
from . import contact as contact
from . import control as control
from . import dynamics as dynamics
from . import errors as errors
from . import gradients as gradients
from . import io as io
from . import layers as layers
from . import mechanism as mechanism
from . import model as model
from . import nonholonomic as nonholonomic
from . import simulation as simulation
from . import stepping as stepping
from . import study as study
from . import viewing as viewing
from ._core.rows import Native as Native
from ._core.work import Processes as Processes
from ._core.work import map_chunks as map_chunks
from .constraints.contacts.frictional_contact import FrictionalContact as FrictionalContact
from .constraints.drift import Baumgarte as Baumgarte
from .constraints.forces import AppliedForce as AppliedForce
from .constraints.loop import Loop as Loop
from .constraints.point_contact import PointContact as PointContact
from .constraints.surface_contact import SurfaceContact as SurfaceContact
from .control.controller import Controller as Controller
from .control.inverse import inverse_dynamics as inverse_dynamics
from .control.inverse_kinematics import solve_ik as solve_ik
from .dynamics.impacts import impact as impact
from .dynamics.scene import Scene as Scene
from .dynamics.solution import Status as Status
from .dynamics.solvers.dense_kkt import DenseKKT as DenseKKT
from .dynamics.solvers.lcaba import LCABA as LCABA
from .dynamics.solvers.proximal import Proximal as Proximal
from .dynamics.workspace import Workspace as Workspace
from .dynamics.workspace import derivatives as derivatives
from .dynamics.workspace import solve as solve
from .errors import CondynError as CondynError
from .errors import InvalidArgument as InvalidArgument
from .errors import SolveFailed as SolveFailed
from .io.load import load_robot as load_robot
from .model.robot import Robot as Robot
from .simulation.batch.answers import solve_batch as solve_batch
from .simulation.batch.motions import simulate_batch as simulate_batch
from .simulation.events import Event as Event
from .simulation.integrators.explicit import RungeKutta4 as RungeKutta4
from .simulation.integrators.explicit import SemiImplicitEuler as SemiImplicitEuler
from .simulation.run import simulate as simulate
from .simulation.trajectory import Trajectory as Trajectory
from .stepping.schemes.moreau import Moreau as Moreau
from .stepping.schemes.stewart_trinkle import StewartTrinkle as StewartTrinkle
from .stepping.single_step import step as step
from .study.study import Study as Study
from .viewing.viewer import view as view

__version__: str
