# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .verbs import view as view
from .viewer import Viewer as Viewer
