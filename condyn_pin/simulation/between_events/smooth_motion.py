"""SmoothMotion: a system as an integrator sees it between two events of its contacts."""

from __future__ import annotations

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.mode_dynamics import ModeDynamics
from condyn_pin.simulation.system import System


class SmoothMotion(System):
    """The same system in the same memory, its contacts in modes that are held.

    What is known at its start is not solved for again.
    """

    def __init__(
        self, system: System, dynamics: ModeDynamics, q: Array, v: Array, a: Array
    ) -> None:
        vars(self).update(vars(system))
        self._whole, self._dynamics, self._known = system, dynamics, (q, v, a)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,) while modes are as they are."""
        q0, v0, a0 = self._known
        if q is q0 and v is v0:
            return a0
        return self._dynamics.solve(ContactTerms(self._whole, t, q, v)).a
