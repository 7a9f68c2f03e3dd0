"""Instant: what is to be seen of a scene at one configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import AnyBound, ConstraintViolation
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.control.balancing import Balance
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce
from condyn_pin.viewing.touching import Felt, Touching, touching_at


@dataclass(frozen=True, eq=False)
class Instant:
    """A scene at one instant, as it is drawn.

    Attributes
    ----------
    joints : list of pin.SE3
        Every joint in the world; the world itself is the first.
    com : (3,) array
        Centre of mass [m].
    ends : mapping of str to pair of pin.SE3
        The frames c1 and c2 of each constraint in the world; couplings have none.
    gaps : mapping of str to ConstraintViolation
        How far each constraint that has a position is open.
    bounds : mapping of str to AnyBound
        The constraints that hold now.
    forces : mapping of str to ConstraintForce
        On the first-named body; empty where none are known.
    touching : mapping of str to Touching
        What may touch a plane.
    balance : Balance or None
        Where it presses on the floor, if somebody asked.
    """

    joints: list[Any]
    com: Array  # [m]
    ends: Mapping[str, tuple[Any, Any]]
    gaps: Mapping[str, ConstraintViolation]
    bounds: Mapping[str, AnyBound]
    forces: Mapping[str, ConstraintForce] = field(default_factory=dict)
    touching: Mapping[str, Touching] = field(default_factory=dict)
    balance: Balance | None = None

    def robot_end(self, name: str) -> Any | None:
        """Return the frame of a contact on the robot; None while it does not hold."""
        if name not in self.ends:
            return None
        return self.ends[name][self.bounds[name].on_robot]


def instant(
    scene: Scene,
    q: Array,
    forces: Mapping[str, ConstraintForce] | None = None,
    felt: Felt | None = None,
    balance: Balance | None = None,
) -> Instant:
    """Return what is to be seen of a scene at q (nq,)."""
    equations = Equations(scene.robot.model, scene.bounds)
    opening = gaps(scene, equations.violation(q))
    placed = zip(scene.names, equations.placements(q), strict=True)
    oMi = [pin.SE3(each) for each in equations.data.oMi]
    touching = dict(touching_at(scene, equations.data, q, felt or Felt()))
    com = np.array(pin.centerOfMass(scene.robot.model, equations.data, q))
    return Instant(
        oMi,
        com,
        {name: (pin.SE3(ends[0]), pin.SE3(ends[1])) for name, ends in placed if ends},
        opening,
        {bound.name: bound for bound in scene.bounds},
        forces or {},
        touching,
        balance,
    )
