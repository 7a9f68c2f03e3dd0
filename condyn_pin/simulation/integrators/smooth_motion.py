"""SmoothMotion: a system as an integrator sees it between two events of its contacts."""

from __future__ import annotations

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_hold import ContactHold
from condyn_pin.simulation.integrators.contact_look import ContactLook
from condyn_pin.simulation.system import System


class SmoothMotion(System):
    """The same system in the same memory, its contacts as a hold says.

    What is known at its start is not solved for again.
    """

    def __init__(self, system: System, hold: ContactHold, q: Array, v: Array, a: Array) -> None:
        vars(self).update(vars(system))
        self._whole, self._hold, self._known = system, hold, (q, v, a)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,) while modes are as they are."""
        q0, v0, a0 = self._known
        if q is q0 and v is v0:
            return a0
        return self._hold.solve(ContactLook(self._whole, t, q, v)).a
