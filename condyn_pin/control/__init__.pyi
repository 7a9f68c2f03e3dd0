# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .actuation import Actuation as Actuation
from .inverse import InverseDynamics as InverseDynamics
from .inverse import gravity_compensation as gravity_compensation
from .inverse import inverse_dynamics as inverse_dynamics
from .operational import OperationalSpace as OperationalSpace
from .operational import operational_space as operational_space
from .transmissions import Transmission as Transmission
from .transmissions import transmission as transmission
