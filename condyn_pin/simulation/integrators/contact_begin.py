"""ContactBegin: what has to happen in an instant before motion goes on smoothly.

    what approaches                       an impact
    what no force lets slide on           a shock
    what would return at once             rests

and then the modes with which it goes on. A contact that leaves with sigma_n > 0 while sigma_n' < 0
is back after 2 sigma_n / -sigma_n': where that is shorter than the shortest bounce, sigma_n is
taken away. Bounces that grow shorter without end, a ball's or those of a box that rocks, end so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.solvers.base import ContactSolver
from condyn_pin.simulation.events import ZenoDetected
from condyn_pin.simulation.integrators.contact_choice import ContactChoice
from condyn_pin.simulation.integrators.contact_hold import ContactHold, Held
from condyn_pin.simulation.integrators.contact_look import ContactLook
from condyn_pin.simulation.integrators.contact_shares import AT_ITS_END, let_go, shared
from condyn_pin.simulation.system import System

# Velocities of what stands still that are rounding, relative to the speed of the robot.
_ROUNDED = 1e-14

# Impacts in one instant, at most: Newton's law lets contacts approach again only by rounding.
_MOST = 100


@dataclass(frozen=True, eq=False)
class Begun:
    """A state from which motion goes on smoothly.

    Attributes
    ----------
    look : ContactLook
        The state behind all that has happened in this instant.
    hold, held : ContactHold, Held
        Modes, and accelerations and forces.
    natural : float
        Residual of the problem that gave the modes [1].
    impulse : (rows,) array
        Of what has happened [N s].
    work : float
        The same [J].
    what : str
        ``impact``, ``shock``, or nothing.
    """

    look: ContactLook
    hold: ContactHold
    held: Held
    natural: float
    impulse: Array
    work: float = 0.0
    what: str = ""

    def without_impulse(self) -> Begun:
        """Return the same once its impulse is counted."""
        return replace(self, impulse=np.zeros_like(self.impulse), work=0.0, what="")


class ContactBegin:
    """Lets happen what has to, for one system.

    Parameters
    ----------
    system : System
    solver : ContactSolver
    shortest : float
        The shortest bounce [s].
    """

    def __init__(self, system: System, solver: ContactSolver, shortest: float) -> None:
        self._system, self._shortest = system, shortest
        self._choice = ContactChoice(system.contacts, solver)

    def at(self, t: float, q: Array, v: Array, *, at_end: bool = False) -> Begun:
        """Return how motion goes on from a state.

        `at_end` says that a force has just come to the end of what its contact can give.
        """
        impulse, work, what = np.zeros(self._system.contacts.rows), 0.0, ""
        for _ in range(_MOST):
            look = ContactLook(self._system, t, q, v)
            if look.approaches.any():
                struck, what = self._choice.impact(look), "impact"
            else:
                choice = self._choice.next(look)
                if choice.hold is not None:
                    hold, held = self._shared(look, choice.hold, at_end)
                    settled = self._settled(look, hold, held)
                    if settled is v:
                        return Begun(look, hold, held, choice.natural, impulse, work, what)
                    v = settled
                    continue
                struck, what = self._choice.shock(look, choice), "shock"
            v, impulse, work = struck.v, impulse + struck.impulse, work + struck.work
            at_end = False
        raise ZenoDetected(f"contacts go on striking at t = {t:g} s; take a stepper, as Moreau()")

    def _shared(
        self, look: ContactLook, hold: ContactHold, at_end: bool
    ) -> tuple[ContactHold, Held]:
        """Return the hold with which motion goes on, its load shared; what has to lets go."""
        shares = shared(self._system.contacts, hold, look)
        if not at_end or shares.least > AT_ITS_END:
            return shares.hold, shares.held
        hold = let_go(self._system.contacts, shares)
        return hold, hold.solve(look)

    def _settled(self, look: ContactLook, hold: ContactHold, held: Held) -> Array:
        """Return v without what returns at once, and without what is left of what stands still."""
        normals = self._system.contacts.normals
        rate, leaving = held.rate[normals], look.touches & ~look.rests
        back = leaving & (2 * look.closing < -self._shortest * rate)
        off = float(np.abs(look.slip[hold.still]).max(initial=0.0))
        if not back.any() and off <= _ROUNDED * look.fastest:
            return look.v
        return look.held(look.v, np.concatenate((hold.still, normals[back])))
