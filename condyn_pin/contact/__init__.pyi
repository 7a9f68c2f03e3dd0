# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .attempts import attempt_contact as attempt_contact
from .cone import ConeRows as ConeRows
from .cone import Margin as Margin
from .friction_cone import FrictionCone as FrictionCone
from .indeterminacy import Indeterminacy as Indeterminacy
from .judge import solve_contact as solve_contact
from .problem import ContactProblem as ContactProblem
from .residuals import ContactResiduals as ContactResiduals
from .residuals import contact_residuals as contact_residuals
from .residuals import natural_residual as natural_residual
from .scene_cones import cone_rows as cone_rows
from .scene_cones import margins as margins
from .sets import ContactSets as ContactSets
from .soft_contact import SoftContact as SoftContact
from .soft_contact import soft_contact as soft_contact
from .solution import ContactSolution as ContactSolution
from .solution import ContactStatus as ContactStatus
from .solvers import CONTACT_SOLVERS as CONTACT_SOLVERS
from .solvers.admm import ADMM as ADMM
from .solvers.base import Attempt as Attempt
from .solvers.base import ContactSolver as ContactSolver
from .solvers.lemke import Lemke as Lemke
from .solvers.newton import SemismoothNewton as SemismoothNewton
from .solvers.pgs import PGS as PGS
from .solvers.sap import SAP as SAP
from .wrench_cone import WrenchCone as WrenchCone
