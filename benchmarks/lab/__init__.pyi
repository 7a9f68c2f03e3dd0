# Every public name of this package, and the file that has it; `__init__.py` reads this file.

from .extremes import CONTACT_EXTREMES as CONTACT_EXTREMES
from .extremes import EXTREMES as EXTREMES
from .extremes.verdicts import Verdict as Verdict
from .extremes.verdicts import judge as judge
from .extremes.verdicts import judge_contact as judge_contact
from .extremes.verdicts import right_answers as right_answers
from .hierarchy import HIERARCHIES as HIERARCHIES
from .hierarchy import HierarchyEffort as HierarchyEffort
from .hierarchy import HierarchyModel as HierarchyModel
from .hierarchy import HierarchyRow as HierarchyRow
from .hierarchy import HierarchyTable as HierarchyTable
from .hierarchy import ModelHierarchy as ModelHierarchy
from .hierarchy import model_hierarchy as model_hierarchy
from .problems import PROBLEMS as PROBLEMS
from .problems import Problem as Problem
from .problems import ProblemResult as ProblemResult
from .problems import load_problem as load_problem
