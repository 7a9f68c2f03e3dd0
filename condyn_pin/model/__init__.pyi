# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .mechanisms.andrews import andrews as andrews
from .mechanisms.bricard import bricard as bricard
from .mechanisms.car import ackermann as ackermann
from .mechanisms.car import car as car
from .mechanisms.chain import chain as chain
from .mechanisms.compass import compass_walker as compass_walker
from .mechanisms.delta import delta as delta
from .mechanisms.five_bar import five_bar as five_bar
from .mechanisms.four_bar import four_bar as four_bar
from .mechanisms.free_bodies import free_ball as free_ball
from .mechanisms.free_bodies import free_box as free_box
from .mechanisms.free_bodies import painleve_rod as painleve_rod
from .mechanisms.n_four_bar import n_four_bar as n_four_bar
from .mechanisms.parallelogram import parallelogram as parallelogram
from .mechanisms.pendulum import pendulum as pendulum
from .mechanisms.rolling import rolling_ball as rolling_ball
from .mechanisms.rolling import rolling_disc as rolling_disc
from .mechanisms.rolling import sleigh as sleigh
from .mechanisms.rolling import unicycle as unicycle
from .mechanisms.stewart import stewart as stewart
from .motors import CoupledMotor as CoupledMotor
from .robot import Robot as Robot
from .smaller import depth_first as depth_first
from .smaller import together as together
from .springs import Spring as Spring
from .springs import SpringDamper as SpringDamper
