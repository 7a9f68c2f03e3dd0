"""The price of a smaller scene: what it changes in the accelerations and forces that are asked for.

At the same motion, of two scenes with the joints that are watched in common,

    error of a      = |a_small - a_full|_inf / max(|a_full|_inf, g)
    error of forces = |f_small - f_full|_inf / max(|f_full|_inf, m g)

with a the accelerations of the watched joints, and f the wrench of all contacts on the floating
base: the rows of the free-flyer in M a + h - tau = J^T lam, to which loops add nothing. It is
unique also where the forces of single contacts are not. Moments count by the metre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin._core.timing import State
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.model.smaller import free_flyers

# Without corrections: errors of a model are not looked for below 1e-10.
_REFERENCE = Reference(refinements=0)


@dataclass(frozen=True)
class ReductionErrors:
    """Relative errors over some states: the worst and the median of each.

    Attributes
    ----------
    a_worst, a_median : float
        Of accelerations, over the larger of the largest of them and gravity.
    force_worst, force_median : float
        Of the wrench of all contacts, over the larger of it and the weight.
    """

    a_worst: float
    a_median: float
    force_worst: float
    force_median: float

    def __str__(self) -> str:
        return (
            f"a {self.a_worst:.1e} (median {self.a_median:.1e}), "
            f"contact wrench {self.force_worst:.1e} (median {self.force_median:.1e})"
        )

    @property
    def worst(self) -> float:
        """The larger one of the two worst errors."""
        return max(self.a_worst, self.force_worst)


def answers(scene: Scene, states: Sequence[State], joints: Sequence[str]) -> tuple[Array, Array]:
    """Return accelerations of the watched joints and contact wrenches, a line a state.

    The wrenches have no columns if the robot does not float or touches nothing.
    """
    equations = equations_of(scene)
    _, watched = indices(scene.robot.model, joints)
    _, base = indices(scene.robot.model, free_flyers(scene.robot) if scene.rows else ())
    found_a, found_f = [], []
    for q, v, tau in states:
        terms = equations.terms(q, v)
        a, lam = _REFERENCE.solve(terms, tau)
        found_a.append(a[watched])
        found_f.append((terms.J.T @ lam)[base])
    return np.array(found_a), np.array(found_f)


def compare(scene: Scene, full: tuple[Array, Array], small: tuple[Array, Array]) -> ReductionErrors:
    """Return the errors of the answers of a smaller scene against those of the full one."""
    estimator = scene.nominal.estimator
    a = _relative(full[0], small[0], estimator.gravity)
    f = _relative(full[1], small[1], scene.nominal.weight)
    return ReductionErrors(float(a.max()), float(np.median(a)), float(f.max()), float(np.median(f)))


def _relative(full: Array, small: Array, floor: float) -> Array:
    if full.shape[1] == 0:
        return np.zeros(len(full))
    size = np.maximum(np.abs(full).max(axis=1), floor)
    errors: Array = np.abs(small - full).max(axis=1) / size
    return errors
