# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .viewer import Viewer as Viewer
from .viewer import view as view
