"""Soundness of models: Pinocchio's algorithms are silently wrong, or crash, on some."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import Forest, algorithms, data_of, rotation_fault
from condyn_pin._core.threads import one_blas_thread
from condyn_pin._core.tolerances import HUGE
from condyn_pin.errors import InvalidModel

# Joints of a robot.
MOST_JOINTS: Final = 2000  # the Data of Pinocchio takes 32 GB of half as many


@one_blas_thread
def check_model(model: Any) -> None:
    """Raise InvalidModel for a model on which Pinocchio's algorithms are silently wrong or crash.

    Cost: one pin.Data, which is what takes time and memory in a long chain.
    """
    if len(model.mimicking_joints):
        names = ", ".join(model.names[i] for i in model.mimicking_joints)
        raise InvalidModel(
            f"mimic joints ({names}): Pinocchio's constrained dynamics refuse them; "
            "load the model without mimic, as independent joints"
        )
    if model.nv == 0:
        raise InvalidModel("the model has no degree of freedom")
    _check_placements(model)
    _check_forces(model)
    data = data_of(model)
    if not (data.is_sound() if isinstance(data, Forest) else model.check(data)):
        raise InvalidModel(
            "the joints were not added depth-first, and Pinocchio's crba is silently wrong on "
            "such a model; condyn_pin.model.depth_first(model) puts them in order"
        )
    _check_bodies(model)
    _check_mass_matrix(model, data)


def _check_placements(model: Any) -> None:
    """Raise InvalidModel if the axes of a joint or frame are no rotation."""
    joints = zip(model.names, model.jointPlacements, strict=True)
    placements = [(f"joint {name!r}", M) for name, M in joints]
    placements += [(f"frame {frame.name!r}", frame.placement) for frame in model.frames]
    for who, M in placements:
        if np.abs(M.translation).max() > HUGE:
            raise InvalidModel(
                f"{who} is {np.abs(M.translation).max():g} m from its parent: what is computed "
                f"from that overflows; {HUGE:g} is the largest number"
            )
        fault = rotation_fault(M.rotation)
        if fault:
            raise InvalidModel(f"the placement of {who} has no rotation: {fault}")


def _check_forces(model: Any) -> None:
    """Raise InvalidModel for angular or huge gravity, and for negative damping or armature."""
    gravity, turning = model.gravity.linear, model.gravity.angular
    if (np.abs(gravity) > HUGE).any() or turning.any():
        raise InvalidModel(
            f"gravity = {gravity.tolist()} m/s^2 with an angular part of {turning.tolist()}: three "
            f"finite numbers up to {HUGE:g} are needed, and no angular part"
        )
    for what, unit in (("damping", "N s/m or N m s/rad"), ("armature", "kg or kg m^2")):
        values = getattr(model, what)
        bad = np.flatnonzero((values > HUGE) | (values < 0))
        if bad.size:
            raise InvalidModel(
                f"the {what} of joint {_joint_of(model, int(bad[0]))!r} is {values[bad[0]]:g} "
                f"{unit}: a number from 0 to {HUGE:g} is needed"
            )


def _check_bodies(model: Any) -> None:
    """Raise InvalidModel if the inertia on a joint is not that of a body."""
    largest = max(float(np.abs(Y.inertia).max()) for Y in model.inertias)
    for name, Y in zip(model.names, model.inertias, strict=True):
        if not np.isfinite([Y.mass, *Y.lever, *Y.inertia.ravel()]).all():
            raise InvalidModel(f"what moves with joint {name!r} has a mass or inertia that is NaN")
        if Y.mass < 0:
            raise InvalidModel(f"the mass on {name} is negative, {Y.mass:g} kg: it must be >= 0")
        if max(Y.mass, *np.abs(Y.lever), np.abs(Y.inertia).max() / HUGE**2) > HUGE:
            raise InvalidModel(
                f"what moves with joint {name!r} has a mass or a centre beyond {HUGE:g}, or an "
                f"inertia beyond {HUGE**3:g}: what is computed from that overflows"
            )
        if 0 < Y.mass < tolerances.LIGHTEST:
            raise InvalidModel(
                f"what moves with joint {name!r} has a mass of {Y.mass:g} kg, and Pinocchio loses "
                f"centres of mass below {tolerances.LIGHTEST:.1e} kg; make it zero, or count "
                "masses in a smaller unit"
            )
        if name == model.names[0]:  # what is fixed to the world moves nothing
            continue
        least, _, most = np.linalg.eigvalsh(Y.inertia)
        if least < -max(tolerances.MOMENT * most, tolerances.MASSLESS * largest):
            raise InvalidModel(
                f"what moves with joint {name!r} has the principal moment {least:g} kg m^2, which "
                "is negative, and no solid has that; correct the inertia of its bodies"
            )
        if Y.mass == 0 and most > tolerances.MASSLESS * largest:
            raise InvalidModel(
                f"what moves with joint {name!r} has a moment of inertia, {most:g} kg m^2, and no "
                "mass; give it one, or the joint an armature in place of the inertia"
            )


def _check_mass_matrix(model: Any, data: Any) -> None:
    """Raise InvalidModel if joints move no inertia at any configuration: M is always singular."""
    # Where M is singular at some of them, as that of a point mass on a slider on a hinge where the
    # slider is at zero, those alone are refused, when they are called for. What moves no inertia in
    # the neutral configuration is looked at again in one that has nothing special.
    anywhere = pin.integrate(model, pin.neutral(model), np.linspace(0.3, 0.7, model.nv))
    bad = _unmoved(model, data, pin.neutral(model))
    if bad.any():
        bad &= _unmoved(model, data, anywhere)
    if bad.any():
        names = dict.fromkeys(_joint_of(model, int(i)) for i in np.flatnonzero(bad))
        raise InvalidModel(
            f"no inertia moves with {', '.join(names)}: M is singular there; give the body a mass "
            "and an inertia, give the joint an armature, or lock it"
        )
    least, moved = _least_moved(model, np.array(algorithms(data).crba(model, data, anywhere)))
    if least <= tolerances.MASSLESS:
        raise InvalidModel(
            f"{', '.join(moved)} can move together without moving inertia: M is singular or "
            "indefinite; look for a body between them without mass, or an inertia below zero"
        )


def _unmoved(model: Any, data: Any, q: Array) -> NDArray[np.bool_]:
    """Flags of the coordinates that move no inertia at q (nv,)."""
    # Turns are compared with turns [kg m^2], and shifts with shifts [kg]: in millimetres a machine
    # is as sound as in metres.
    M = np.array(algorithms(data).crba(model, data, q))
    diagonal = np.diag(M)
    if not np.isfinite(M).all():
        raise InvalidModel("the mass matrix is not finite: a mass, inertia or placement is NaN")
    turns = np.abs(algorithms(data).computeJointJacobians(model, data, q)[3:]).max(axis=0) > 0
    largest = [diagonal[turns == kind].max(initial=0.0) for kind in (False, True)]
    least = tolerances.MASSLESS * np.where(turns, *largest[::-1])
    return np.asarray(diagonal <= np.maximum(least, HUGE**-3))  # no inverse below that


def massless_motion(
    model: Any, q: Array, *, share: float = tolerances.MASSLESS, data: Any = None
) -> str:
    """Message about joints that move no inertia at q; empty if M is definite."""
    # `share` is the least inertia that counts, relative to those that each joint alone moves;
    # `data` may be written to, for that of a long chain is large. Hinges with massless links
    # between them stand in for a ball until two of their axes fall together: there they can turn
    # against each other, and M is singular.
    data = data or data_of(model)
    M = np.array(algorithms(data).crba(model, data, q))
    if not np.isfinite(M).all():
        return ""
    least, names = _least_moved(model, M)
    if least > share:
        return ""
    singular = least <= tolerances.MASSLESS
    what, almost = ("not positive definite", "") if singular else ("nearly singular", "almost ")
    values = np.array2string(q, precision=4, separator=", ", max_line_width=10**6)
    several = len(names) > 1
    like, cure = (
        ("hinges in the place of a ball where two of their axes fall together",
         "give the links between them an inertia or the joints an armature, make them a ball")
        if several
        else ("a hinge with all mass on its axis",
              "give what it carries an inertia or the joint an armature")
    )  # fmt: skip
    return (
        f"the mass matrix is {what} at q = {values}: {', '.join(names)} can move there "
        f"{almost}without moving inertia, as {like}; {cure}, or stay away from that q"
    )


def singular_mass(model: Any, q: Array) -> Callable[[], str]:
    """Deferred message about joints that move no inertia at q: to compute it is expensive."""
    return partial(massless_motion, model, q)


def _least_moved(model: Any, M: Array) -> tuple[float, tuple[str, ...]]:
    """Smallest eigenvalue of M scaled to a unit diagonal, and the joints of its eigenvector."""
    scale = 1 / np.sqrt(np.maximum(M.diagonal(), HUGE**-3))
    values, vectors = np.linalg.eigh(M * scale * scale[:, None])  # scale^2 may overflow
    moved = np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)
    names = dict.fromkeys(_joint_of(model, int(i)) for i in moved)
    return float(values[0]), tuple(names)


def _joint_of(model: Any, velocity_index: int) -> str:
    for i in range(1, model.njoints):
        joint = model.joints[i]
        if joint.idx_v <= velocity_index < joint.idx_v + joint.nv:
            return str(model.names[i])
    raise IndexError(velocity_index)
