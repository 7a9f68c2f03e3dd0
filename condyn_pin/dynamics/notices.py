"""Notices: what deserves attention in an answer, a sentence each."""

from __future__ import annotations

from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin.dynamics.force import Sites, pulling
from condyn_pin.dynamics.solution import Solution, Status
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.model.soundness import massless_motion

# Forces, as a multiple of the weight, that deserve a look at the singular values.
_HEAVY: Final = 1e3


def notices_of(solution: Solution, sites: Sites) -> tuple[str, ...]:
    """Return what there is to say of an answer, whose constraints act at these sites."""
    return pulling(solution.forces, sites) + _wrong_forces(solution) + _doubts(solution)


def _wrong_forces(solution: Solution) -> tuple[str, ...]:
    """Return that it is the forces which keep an answer from being ok."""
    if solution.status is not Status.INACCURATE or not solution.error_bound <= tolerances.SOLVED:
        return ()
    return (
        f"a is right to {solution.error_bound:.1e}, the forces are not: the equation of a joint is "
        f"off by {solution.dynamics_error:.1e} N or N m, more than {tolerances.FORCES:g} of the "
        "largest torque",
    )


def _doubts(solution: Solution) -> tuple[str, ...]:
    """Return what `Scene.rank` says where it is singular, or the answer is not as it should be."""
    scene, ok = solution.scene, solution.status.ok
    if not ok:
        share = tolerances.NEARLY_MASSLESS
        if said := massless_motion(scene.robot.model, solution.q, share=share):
            return (said,)
    if not scene.rows:
        return ()
    nominal = scene.nominal
    heavy = np.abs(solution.lam).max(initial=0.0) > _HEAVY * nominal.weight
    scale = max(float(np.abs(solution.a).max()), nominal.estimator.gravity)
    # of contradicting rows the best a is still unique, and may be ok
    unmet = solution.constraint_error > tolerances.SOLVED * scale
    try:
        at = scene.rank(solution.q)
        return at.notes if heavy or unmet or not ok or at.singular else ()
    except (InvalidModel, InvalidArgument):  # numbers that nothing can be said of
        return ()
