"""What forces of contacts do to the bodies: wrenches, for a proof that asks for no Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.forces import Load


def contact_load(
    model: Any, data: Any, q: Array, bounds: Sequence[BoundContact], lam: Array
) -> Load:
    """Return the forces lam of all candidates at q (rows,) [N, N m] as a load.

    The load's wrenches are those of cones, on the robot and on what carries its ground; its torque
    is that of stops and of dry friction. The data is written to.
    """
    candidates = Candidates(model, bounds)
    algorithms(data).forwardKinematics(model, data, q)
    points, axes = candidates.points(data, q), candidates.axes(data, q)
    cones = 3 * candidates.cones
    wrenches = []
    forces = lam[:cones].reshape(-1, 3)
    for (joint, ground), p, E, force in zip(_bodies(bounds), points, axes, forces, strict=True):
        if force.any():  # a point of a pair that has none may be nowhere
            f = E @ force
            on_robot = pin.Force(f, np.cross(p, f))  # at the world's origin
            wrenches.append((joint, data.oMi[joint].actInv(on_robot)))
            wrenches.append((ground, data.oMi[ground].actInv(-on_robot)))
    torque = np.zeros(model.nv)
    stops = chain.from_iterable(bound.stops for bound in bounds)
    dry = chain.from_iterable(bound.dry for bound in bounds)
    along = [(s.iv, s.sign) for s in stops] + [(d.iv, 1.0) for d in dry]
    for (iv, sign), force in zip(along, lam[cones:], strict=True):
        torque[iv] += sign * force
    return Load(torque, np.abs(torque), tuple(wrenches), ())


def _bodies(bounds: Sequence[BoundContact]) -> list[tuple[int, int]]:
    """Return the joints that carry the two sides of each cone, in the order of `Candidates`."""
    bodies = [(touch.joint, touch.ground) for bound in bounds for touch in bound.touches]
    pairs = [pair for bound in bounds for pair in bound.pairs]
    return bodies + [(pair.joint, pair.ground) for pair in pairs for _ in range(pair.points)]
