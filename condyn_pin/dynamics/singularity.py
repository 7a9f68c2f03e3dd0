"""Whether a scene is singular at q: fewer rows are independent there than nearby."""

from __future__ import annotations

from typing import TYPE_CHECKING

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.reach import reach
from condyn_pin.dynamics.kept import equations_of
from condyn_pin.model.soundness import singular_mass

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


def is_singular(scene: Scene, q: Array) -> bool:
    """Whether fewer rows are independent at q than at configurations nearby, as `Rank.singular`."""
    equations = equations_of(scene)
    factors = factors_at(scene, equations, q, equations.mass(q), equations.jacobian(q))
    return factors.rank < scene.chains.rank


def factors_at(scene: Scene, equations: Equations, q: Array, M: Array, J: Array) -> MinimumNorm:
    """Return M and J factorised, without the singular values that are zeros but for rounding."""
    share = tolerances.ISOLATED if scene.chains.isolated else tolerances.RANK
    factors = factorise(M, J, share, why=singular_mass(scene.robot.model, q))
    return factors.above_rounding(reach(equations, q))
