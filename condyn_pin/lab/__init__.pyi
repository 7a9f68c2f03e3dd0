# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .contact_extremes import CONTACT_EXTREMES as CONTACT_EXTREMES
from .extremes import EXTREMES as EXTREMES
from .extremes.contact_verdict import judge_contact as judge_contact
from .extremes.verdict import Verdict as Verdict
from .extremes.verdict import judge as judge
from .extremes.verdict import right_answers as right_answers
from .hierarchies import HIERARCHIES as HIERARCHIES
from .hierarchy import HierarchyEffort as HierarchyEffort
from .hierarchy import HierarchyModel as HierarchyModel
from .hierarchy import ModelHierarchy as ModelHierarchy
from .hierarchy import model_hierarchy as model_hierarchy
from .hierarchy_table import HierarchyRow as HierarchyRow
from .hierarchy_table import HierarchyTable as HierarchyTable
from .problems import PROBLEMS as PROBLEMS
from .problems import Problem as Problem
from .problems import load_problem as load_problem
from .problems.result import ProblemResult as ProblemResult
