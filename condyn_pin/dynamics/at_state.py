"""One state of a scene: its terms and their factors, for what is not a solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Arguments
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin.constraints.applied_force import AppliedForce
from condyn_pin.constraints.loads import Load, Loads
from condyn_pin.constraints.rows.terms import Terms, finite_terms
from condyn_pin.dynamics.kept import equations_of
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.soundness import singular_mass


@dataclass(frozen=True, eq=False)
class State:
    """A checked state with M, h, J, gamma, and the factors of M and J; q and v are owned."""

    q: Array
    v: Array
    terms: Terms
    factors: MinimumNorm


def at_state(scene: Scene, q: ArrayLike, v: ArrayLike | None = None) -> State:
    """Return the terms of a scene at a state, at rest by default; O(n^3 + m^2 n)."""
    check_scene(scene)
    equations = equations_of(scene)
    still = np.zeros(scene.robot.nv)
    q_, v_, _ = Arguments(equations.model).check(q, still if v is None else v, still)
    terms = finite_terms(equations, q_, v_)
    factors = factorise(terms.M, terms.J, tolerances.RANK, why=singular_mass(equations.model, q_))
    return State(q_.copy(), v_.copy(), terms, factors)


def load_on(scene: Scene, q: Array, forces: Sequence[AppliedForce]) -> Load:
    """Return what forces, all constant, are at a configuration that was checked."""
    equations = equations_of(scene)
    return Loads(scene.robot, equations.model, equations.data).at(q, forces)


def frame_jacobian(scene: Scene, q: Array, frame: str) -> Array:
    """Return the Jacobian (6, nv) of a frame: linear first, in the axes of the world."""
    joint, placement = scene.robot.frame(frame)
    if joint == 0:
        raise InvalidArgument(f"frame = {frame!r}: it belongs to the world, which does not move")
    equations = equations_of(scene)
    model, data = equations.model, equations.data
    pin.computeJointJacobians(model, data, q)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = np.array(pin.getFrameJacobian(model, data, joint, placement, axes))
    return J.reshape(6, model.nv)  # a single column comes as a vector
