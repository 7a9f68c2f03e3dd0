"""Starts: how the start of the equations of a step changes with that of the step.

Those that are posed in the middle begin at q (+) dt v / 2, with v in the axes of there, and torques
are those of there; all others have torques of the beginning. Springs and damping act in the middle
of the step or at its end (`torque_partials`). All else is differentiated by where the equations are
taken, by their v and tau; the chain rule comes last.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.routes.floating_partials import FloatingPartials
from condyn_pin.simulation.routes.torque_partials import torque_partials
from condyn_pin.simulation.system import System


class Starts:
    """The starts of the steps of one system by one scheme and dt."""

    def __init__(
        self, system: System, scheme: ContactScheme, dt: float, partials: FloatingPartials
    ) -> None:
        self._system, self._scheme, self._dt = system, scheme, dt
        self._partials = partials
        self._held = dict[float, Array | None]()  # by how far ahead springs and damping act

    def chain(self, t: float, q: Array, v: Array, posed: Posed) -> Array | None:
        """Return where the equations are, their v and tau by q, v and tau (3 nv, 3 nv).

        None where they are these: 1.
        """
        n, ahead, start = len(v), posed.span, (q, v)
        if self._scheme.at_midpoint:
            ahead, t, q, v = ahead - 0.5 * self._dt, posed.t, posed.at, posed.v
        pulled = self._pulls(t, q, v, ahead)
        if pulled is None and not self._scheme.at_midpoint:
            return None
        chain = np.eye(3 * n)
        if self._scheme.at_midpoint:
            half = 0.5 * self._dt
            chain[:n, :n], by_move = self._partials.integrate(start[0], half * start[1])
            chain[:n, n : 2 * n] = half * by_move
            chain[n : 2 * n, n : 2 * n] = self._partials.turned(start[1], half, by_move)
        if pulled is not None:
            chain[2 * n :, : 2 * n] = pulled.dot(chain[: 2 * n, : 2 * n])
        return chain

    def _pulls(self, t: float, q: Array, v: Array, ahead: float) -> Array | None:
        """Return the torques by q and v (nv, 2 nv), None of those that are held alone.

        Those that are held, and springs of joints, change alike everywhere.
        """
        system, model = self._system, self._system.model
        is_held = system.applied.constant is not None and system.passive.between is None
        if not is_held:
            return self._pulled(t, q, v, ahead)
        if ahead not in self._held:
            still = pin.neutral(model), np.zeros(model.nv)
            self._held[ahead] = self._pulled(0.0, *still, ahead)
        return self._held[ahead]

    def _pulled(self, t: float, q: Array, v: Array, ahead: float) -> Array | None:
        pulled = np.hstack(torque_partials(self._system, t, q, v, ahead))
        return pulled if pulled.any() else None
