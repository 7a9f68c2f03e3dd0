"""Snapshot: the state of a motion at one instant, as an event's condition sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from condyn_pin._core.arrays import Array, locked
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.problem import MODES
from condyn_pin.dynamics.solution import ConstraintForce, Sites
from condyn_pin.simulation.contact_columns import contact_rows
from condyn_pin.simulation.contact_record import codes_in
from condyn_pin.simulation.system import NO_TOUCH, System


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a motion at one instant, passed to the condition of an event.

    Attributes
    ----------
    t : float
        Time [s].
    q, v : (nq,), (nv,) array
        Configuration [rad, m] and velocity [rad/s, m/s], read-only: they are the state itself.
    """

    t: float
    q: Array
    v: Array
    _system: System

    def __post_init__(self) -> None:
        object.__setattr__(self, "_state", (self.q, self.v))  # that the system knows again
        object.__setattr__(self, "q", locked(self.q))
        object.__setattr__(self, "v", locked(self.v))

    @cached_property
    def a(self) -> Array:
        """Accelerations (nv,) [rad/s^2, m/s^2]; they cost a solve."""
        return self._solved[0]

    @property
    def forces(self) -> dict[str, ConstraintForce | Array]:
        """Force on the first-named body by constraint, and on the robot by contact.

        Those of contacts are (t1, t2, n) [N]. They cost a solve, or a step where contacts may open.
        """
        system = self._system
        rows, lam = system.scene.rows, self._solved[1]
        held = Sites(system.scene, self.q, system.equations).forces(lam[:rows])
        contacts = contact_rows(system.contacts).items()
        return {**held, **{name: lam[rows:][its] for name, its in contacts}}

    @property
    def gaps(self) -> dict[str, float]:
        """Distance of each contact and stop [m, rad]."""
        data = self._system.equations.data
        algorithms(data).forwardKinematics(self._system.model, data, self.q)
        gaps = self._system.contacts.exact.gaps(data, self.q)
        return dict(zip(self._system.contacts.names, gaps.tolist(), strict=False))

    @property
    def modes(self) -> dict[str, str]:
        """Mode of each contact in the step that begins here: open, stick or slide."""
        codes = self._solved[2]
        return {n: MODES[int(c)] for n, c in zip(self._system.contacts.names, codes, strict=True)}

    def position(self, frame: str) -> Array:
        """Return where the origin of a frame is in the world (3,) [m]."""
        joint, placement = self._system.scene.robot.frame(frame)
        model, data = self._system.model, self._system.equations.data
        algorithms(data).forwardKinematics(model, data, self.q)
        return np.array((data.oMi[joint] * placement).translation)

    def velocity(self, frame: str) -> Array:
        """Return how fast the origin of a frame moves in the world (3,) [m/s]."""
        joint, placement = self._system.scene.robot.frame(frame)
        model, data = self._system.model, self._system.equations.data
        algorithms(data).forwardKinematics(model, data, self.q, self.v)
        return np.array(
            (data.oMi[joint] * placement).rotation @ placement.actInv(data.v[joint]).linear
        )

    @cached_property
    def _solved(self) -> tuple[Array, Array, Array]:
        system, state = self._system, self._state  # type: ignore[attr-defined]
        if system.contacts.names:
            _, _, _, a, lam, _, touch = system.look(self.t, *state)
            return a, lam, codes_in(touch, len(system.contacts.names))
        return system.acceleration(self.t, *state), system.lam(), NO_TOUCH
