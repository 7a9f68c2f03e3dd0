"""Contacts of the robot with the world, by name; each kind is a file of its own.

The rows are those of a loop whose other body is the world (`condyn_pin.constraints.loop`).
Without an anchor a contact holds what it touches where it is: it has no position error.
"""

from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.planar_contact import PlanarContact
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.constraints.surface_contact import SurfaceContact

__all__ = ["LineContact", "PlanarContact", "PointContact", "SurfaceContact"]
