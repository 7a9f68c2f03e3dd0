"""Touching: where a contact that may let go is now, how it touches, and what it feels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene


@dataclass(frozen=True, eq=False)
class Felt:
    """What an answer knows of contacts, by name.

    Attributes
    ----------
    forces : mapping of str to (3,) array
        On the robot, in the axes t1, t2, n of each [N].
    modes : mapping of str to str
        Open, stick or slide.
    """

    forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Touching:
    """A point that may touch a plane, at one configuration.

    Attributes
    ----------
    at : (3,) array
        The contact point [m].
    axes : (3, 3) array
        t1, t2 and n in the world, column by column.
    gap : float
        Signed distance [m].
    friction : float
        Coulomb's coefficient [1].
    on, by : str
        Whom the force is on, and what gives it.
    mode : str
        Open, stick or slide; empty where nobody has asked.
    force : (3,) array
        In the axes t1, t2, n [N]; zero where none is known.
    """

    at: Array  # [m]
    axes: Array
    gap: float  # [m]
    friction: float
    on: str
    by: str
    mode: str
    force: Array  # [N]

    def in_world(self) -> Array:
        """Return the force in the axes of the world (3,) [N]."""
        return np.asarray(self.axes @ self.force)

    def on_other(self) -> Touching:
        """Return it with the opposite force, on the other body."""
        return replace(self, on=self.by, by=self.on, force=-self.force)

    def on_plane(self) -> Array:
        """Return the point of the plane below it (3,) [m]."""
        return np.asarray(self.at - self.gap * self.axes[:, 2])


def touching_at(scene: Scene, data: Any, q: Array, felt: Felt) -> Iterator[tuple[str, Touching]]:
    """Yield the cones of a scene by name; reads data.oMi at q (nq,)."""
    if not scene.contacts:
        return
    model = scene.robot.model
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    grounds = dict(cone for bound in scene.contact_bounds for cone in bound.cones)
    gaps, points = candidates.gaps(data, q), candidates.points(data, q)
    axes = candidates.axes(data, q)
    for i, name in enumerate(candidates.names[: candidates.cones]):
        if not np.isfinite(gaps[i]):  # two bodies may meet in fewer places
            continue
        yield name, Touching(
            points[i].copy(), axes[i].copy(), float(gaps[i]), float(candidates.friction[i]),
            name, model.names[grounds[name]], felt.modes.get(name, ""),
            np.asarray(felt.forces.get(name, np.zeros(3))),
        )  # fmt: skip
