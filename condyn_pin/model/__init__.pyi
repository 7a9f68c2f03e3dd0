# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .mechanisms.chain import chain as chain
from .mechanisms.four_bar import four_bar as four_bar
from .mechanisms.n_four_bar import n_four_bar as n_four_bar
from .mechanisms.pendulum import pendulum as pendulum
from .mechanisms.rolling_ball import rolling_ball as rolling_ball
from .mechanisms.rolling_disc import rolling_disc as rolling_disc
from .mechanisms.sleigh import sleigh as sleigh
from .mechanisms.unicycle import unicycle as unicycle
from .robot import Robot as Robot
from .spring import Spring as Spring
from .spring import SpringDamper as SpringDamper
