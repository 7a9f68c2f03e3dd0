"""Constraints on the velocity, by name; each kind is a file of its own."""

from condyn_pin.constraints.knife_edge import KnifeEdge
from condyn_pin.constraints.on_velocity import Nonholonomic
from condyn_pin.constraints.rolling_ball import RollingBall
from condyn_pin.constraints.rolling_wheel import RollingWheel

__all__ = ["KnifeEdge", "Nonholonomic", "RollingBall", "RollingWheel"]
