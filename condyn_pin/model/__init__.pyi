# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .joints import CoupledMotor as CoupledMotor
from .mechanisms.free_bodies import free_ball as free_ball
from .mechanisms.free_bodies import free_box as free_box
from .mechanisms.free_bodies import painleve_rod as painleve_rod
from .mechanisms.planar import andrews as andrews
from .mechanisms.planar import chain as chain
from .mechanisms.planar import compass_walker as compass_walker
from .mechanisms.planar import five_bar as five_bar
from .mechanisms.planar import four_bar as four_bar
from .mechanisms.planar import n_four_bar as n_four_bar
from .mechanisms.planar import parallelogram as parallelogram
from .mechanisms.planar import pendulum as pendulum
from .mechanisms.rolling import ackermann as ackermann
from .mechanisms.rolling import car as car
from .mechanisms.rolling import rolling_ball as rolling_ball
from .mechanisms.rolling import rolling_disc as rolling_disc
from .mechanisms.rolling import sleigh as sleigh
from .mechanisms.rolling import unicycle as unicycle
from .mechanisms.spatial import bricard as bricard
from .mechanisms.spatial import delta as delta
from .mechanisms.spatial import stewart as stewart
from .robot import Robot as Robot
from .smaller import depth_first as depth_first
from .smaller import together as together
from .springs import Spring as Spring
from .springs import SpringDamper as SpringDamper
