# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .load import available_robots as available_robots
from .load import load_robot as load_robot
