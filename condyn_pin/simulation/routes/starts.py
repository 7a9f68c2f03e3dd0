"""Start: how the start of the equations of a step changes with that of the step.

Those that are posed in the middle begin at q (+) dt v / 2, with v in the axes of there. Springs and
damping act at the end of the step, by what they are at its beginning (`torque_partials`).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.routes.columns import Columns
from condyn_pin.simulation.routes.floating_partials import FloatingPartials
from condyn_pin.simulation.routes.torque_partials import torque_partials
from condyn_pin.simulation.system import System


class Start(NamedTuple):
    """How the start of the equations changes with all columns (nv, columns) each."""

    at: Array  # where M, h and J are taken
    v: Array  # the velocity before
    pulled: Array  # torques, as they act at the end of the step


class Starts:
    """The starts of the steps of one system by one scheme and dt."""

    def __init__(
        self, system: System, scheme: ContactScheme, dt: float, partials: FloatingPartials,
        columns: Columns,
    ) -> None:  # fmt: skip
        self._system, self._scheme, self._dt = system, scheme, dt
        self._partials, self._columns = partials, columns

    def at(self, t: float, q: Array, v: Array) -> Start:
        """Return how q and v of the equations, and the torques, change with those of the step."""
        at, moving = self._half_way(q, v) if self._scheme.at_midpoint else self._from_there
        system = self._system
        held = system.applied.constant is not None and system.passive.between is None
        return Start(at, moving, self._held if held else self._pulled(t, q, v))

    def _half_way(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q (+) dt v / 2, and v in its axes, by all columns (nv, columns) each."""
        columns, half = self._columns, 0.5 * self._dt
        at, moving = columns.empty(), columns.empty()
        at[:, columns.q], by_move = self._partials.integrate(q, half * v)
        at[:, columns.v] = half * by_move
        moving[:, columns.v] = self._partials.turned(v, half)
        return at, moving

    @cached_property
    def _from_there(self) -> tuple[Array, Array]:
        """The same of steps that are posed where they begin: q and v themselves."""
        columns = self._columns
        at, moving = columns.empty(), columns.empty()
        at[:, columns.q] = moving[:, columns.v] = np.eye(columns.nv)
        return at, moving

    def _pulled(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques by all columns (nv, columns)."""
        columns, pulled = self._columns, self._columns.empty()
        by_q_and_v = torque_partials(self._system, t, q, v, self._dt)
        pulled[:, columns.q], pulled[:, columns.v] = by_q_and_v
        pulled[:, columns.tau] = np.eye(len(v))
        return pulled

    @cached_property
    def _held(self) -> Array:
        """The same of torques that are held, and of springs of joints: it is so everywhere."""
        model = self._system.model
        return self._pulled(0.0, pin.neutral(model), np.zeros(model.nv))
