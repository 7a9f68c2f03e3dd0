"""Transition: what has to happen in an instant before motion goes on smoothly.

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
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.load_sharing import AT_ITS_END, let_go, shared
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics
from condyn_pin.simulation.between_events.next_modes import NextModes
from condyn_pin.simulation.events import ZenoDetected
from condyn_pin.simulation.remarks import Note, notes_of
from condyn_pin.simulation.system import System

# Velocities of what stands still that are rounding, relative to the speed of the robot.
_ROUNDED = 1e-14

# Impacts in one instant, at most: behind one contacts approach again only by rounding.
_MOST = 100


@dataclass(frozen=True, eq=False)
class Begun:
    """A state from which motion goes on smoothly.

    Attributes
    ----------
    terms : ContactTerms
        The state behind all that has happened in this instant.
    dynamics, held : ModeDynamics, Held
        Modes, and accelerations and forces.
    natural : float
        Residual of the problem that gave the modes [1].
    impulse : (rows,) array
        Of what has happened [N s].
    work : float
        The same [J].
    driven : float
        What driven constraints did in it [J].
    what : str
        ``impact``, ``shock``, or nothing.
    """

    terms: ContactTerms
    dynamics: ModeDynamics
    held: Held
    natural: float
    impulse: Array
    work: float = 0.0
    driven: float = 0.0
    what: str = ""

    def without_impulse(self) -> Begun:
        """Return the same once its impulse is counted."""
        return replace(self, impulse=np.zeros_like(self.impulse), work=0.0, driven=0.0, what="")


class Transition:
    """Lets happen what has to, for one system.

    Parameters
    ----------
    system : System
    choice : NextModes
    shortest : float
        The shortest bounce [s].
    """

    def __init__(self, system: System, choice: NextModes, shortest: float) -> None:
        self._system, self._shortest = system, shortest
        self._choice = choice

    def at(self, t: float, q: Array, v: Array, *, at_end: bool = False) -> Begun:
        """Return how motion goes on from a state.

        `at_end` says that a force has just come to the end of what its contact can give.
        """
        impulse, what = np.zeros(self._system.contacts.rows), ""
        work = driven = 0.0
        for _ in range(_MOST):
            terms = ContactTerms(self._system, t, q, v)
            if terms.approaches.any():
                struck, what = self._choice.impact(terms), "impact"
                self._note(t)
                self._system.remarks.note(t, [Note(*note) for note in struck.notes])
            else:
                choice = self._choice.next(terms)
                self._note(t)
                if choice.dynamics is not None:
                    dynamics, held = self._shared(terms, choice.dynamics, at_end)
                    settled = self._settled(terms, dynamics, held)
                    if settled is v:
                        return Begun(
                            terms, dynamics, held, choice.natural, impulse, work, driven, what
                        )
                    v = settled
                    continue
                struck, what = self._choice.shock(terms, choice), "shock"
            v, impulse = struck.v, impulse + struck.impulse
            work, driven = work + struck.work, driven + struck.driven
            at_end = False
        raise ZenoDetected(f"contacts go on striking at t = {t:g} s; take a stepper, as Moreau()")

    def _note(self, t: float) -> None:
        """Note what the last contact problem leaves open."""
        if self._choice.several:
            self._system.remarks.note(t, notes_of(self._choice.several))

    def _shared(
        self, terms: ContactTerms, dynamics: ModeDynamics, at_end: bool
    ) -> tuple[ModeDynamics, Held]:
        """Return the modes with which motion goes on, the load shared; what has to lets go."""
        shares = shared(self._system.contacts, dynamics, terms)
        if not at_end or shares.least > AT_ITS_END:
            return shares.dynamics, shares.held
        dynamics = let_go(self._system.contacts, shares)
        return dynamics, dynamics.solve(terms)

    def _settled(self, terms: ContactTerms, dynamics: ModeDynamics, held: Held) -> Array:
        """Return v without what returns at once, and without what is left of what stands still."""
        normals = self._system.contacts.normals
        rate, leaving = held.rate[normals], terms.touches & ~terms.rests
        back = leaving & (2 * terms.closing < -self._shortest * rate)
        off = float(np.abs(terms.sigma[dynamics.still]).max(initial=0.0))
        if not back.any() and off <= _ROUNDED * terms.fastest:
            return terms.v
        return terms.held(terms.v, np.concatenate((dynamics.still, normals[back])))
