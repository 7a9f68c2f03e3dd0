# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .derivatives.base import Derivatives as Derivatives
from .force import ConstraintForce as ConstraintForce
from .impacts import Impact as Impact
from .impacts import impact as impact
from .nominal import NominalAnalysis as NominalAnalysis
from .residuals import Residuals as Residuals
from .scene import Scene as Scene
from .solution import Solution as Solution
from .solution import StateError as StateError
from .solution import Status as Status
from .solvers import SOLVERS as SOLVERS
from .solvers import Solver as Solver
from .solvers.base import BoundSolver as BoundSolver
from .solvers.base import Singular as Singular
from .solvers.conjugate_gradient import ConjugateGradient as ConjugateGradient
from .solvers.delassus_cholesky import DelassusCholesky as DelassusCholesky
from .solvers.dense_kkt import DenseKKT as DenseKKT
from .solvers.gauss_principle import GaussPrinciple as GaussPrinciple
from .solvers.lcaba import LCABA as LCABA
from .solvers.null_space import NullSpace as NullSpace
from .solvers.proximal import Proximal as Proximal
from .solvers.reference import Reference as Reference
from .solvers.soft import Soft as Soft
from .solvers.sparse_kkt import SparseKKT as SparseKKT
from .verbs import solve as solve
from .workspace import Workspace as Workspace
