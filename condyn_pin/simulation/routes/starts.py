"""Starts: how the start of the equations of a step changes with that of the step.

Those that are posed in the middle begin at q (+) dt v / 2, with v in the axes of there. Springs and
damping act at the end of the step, by what they are at its beginning (`torque_partials`). All else
is differentiated by where the equations are taken, by their v and tau; the chain rule comes last.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
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

    def chain(self, t: float, q: Array, v: Array) -> Array | None:
        """Return where the equations are, their v and tau by q, v and tau (3 nv, 3 nv).

        None where they are these: 1.
        """
        system, n = self._system, len(v)
        held = system.applied.constant is not None and system.passive.between is None
        pulled = self._held if held else self._pulled(t, q, v)
        if pulled is None and not self._scheme.at_midpoint:
            return None
        chain = np.eye(3 * n)
        if pulled is not None:
            chain[2 * n :, : 2 * n] = pulled
        if self._scheme.at_midpoint:
            half = 0.5 * self._dt
            chain[:n, :n], by_move = self._partials.integrate(q, half * v)
            chain[:n, n : 2 * n] = half * by_move
            chain[n : 2 * n, n : 2 * n] = self._partials.turned(v, half, by_move)
        return chain

    def _pulled(self, t: float, q: Array, v: Array) -> Array | None:
        """Return the torques by q and v (nv, 2 nv), None of those that are held alone."""
        pulled = np.hstack(torque_partials(self._system, t, q, v, self._dt))
        return pulled if pulled.any() else None

    @cached_property
    def _held(self) -> Array | None:
        """The same of torques that are held, and of springs of joints: it is so everywhere."""
        model = self._system.model
        return self._pulled(0.0, pin.neutral(model), np.zeros(model.nv))
