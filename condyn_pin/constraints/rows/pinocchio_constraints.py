"""What Pinocchio's own methods take: constraints of 3 and of 6 rows.

A kind with other rows is handed to them as an equivalent of such rows, where there is one. A hinge
about the axis e is two points on it, at d and -d with d = lever e; their velocities are
those of the hinge by

    s(d) = s_xyz + s_rxryrz x d = E s,      and so      lam = E^T lam_native.

The equivalent has 6 rows of rank 5. A planar pin about e is a ball without the row along e. In a
linkage in a plane, where its bodies are always as far apart along e as they are now, that row is
zero, and a ball at c1 + (e . r) e and c2 is the pin:

    s_ball = E s,     E = columns of 1 but for that of e.

With T = J1 - X J2 the twist of body 1 past body 2, column by column, both stay in the plane across
e if no joint shifts one past the other along e, or turns it about another axis:

    e . T_lin = 0,      e x T_ang = 0       for every column.

T is made of analytic functions of q: zero at a place of no special choice, zero everywhere.

Both are exact where the loop is closed (`condyn_pin.dynamics.corrections` has the others).

A planar pin in space, a slider, a rod, a plane, a coupling, a blade and what rolls have no
equivalent: three rows of a point, or six of a frame, hold more than they do. A rod is one of them:
the two rows across it could only be given back by joints of bodies without mass, which have no M.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.loads import frame_jacobian
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound, PinocchioConstraint
from condyn_pin.constraints.rows.cancellation import ROUNDED
from condyn_pin.constraints.rows.point_pairs import spread


@dataclass(frozen=True, eq=False)
class PinocchioConstraints:
    """The constraints of a scene as Pinocchio takes them.

    Attributes
    ----------
    constraints : tuple of PinocchioConstraint
    to_scene : (m, m_native) array or None
        E^T with the signs of the scene: lam from Pinocchio's; None where they are the same.
    approximated : tuple of str
        Names of constraints that take rows of Pinocchio's with one too many.
    world_first : tuple of str
        Those of them whose first frame is the world's, which `pin.lcaba` must not see.
    loops : tuple of str
        Names of constraints that join two moving bodies.
    unsupported : tuple of str
        Names of constraints without an equivalent.
    """

    constraints: tuple[PinocchioConstraint, ...]
    to_scene: Array | None
    approximated: tuple[str, ...]
    world_first: tuple[str, ...]
    loops: tuple[str, ...]
    unsupported: tuple[str, ...]


def pinocchio_constraints(
    model: Any, bounds: Sequence[AnyBound], rows: Callable[[], Array]
) -> PinocchioConstraints:
    """Return the constraints of a scene as Pinocchio takes them.

    `rows` returns the Jacobian at the nominal state in the metric of M, J L^-T (m, nv).
    """
    made: list[PinocchioConstraint] = []
    blocks: list[Array | None] = []
    approximated: list[tuple[str, int]] = []
    loops: list[str] = []
    unsupported: list[str] = []
    for bound in bounds:
        points, block = _equivalent(model, bound)
        made += points
        blocks.append(block)
        if not points:
            unsupported.append(bound.name)
            continue
        if points[0].approximates:
            approximated.append((bound.name, points[0].joint1))
        if points[0].joint1 and points[0].joint2:
            loops.append(bound.name)
    E_T = None if all(block is None for block in blocks) else _side_by_side(blocks, bounds)
    constraints, W = spread(made, lambda: rows() if E_T is None else E_T.T @ rows())
    to_scene = E_T if W is None else W.T if E_T is None else E_T @ W.T
    return PinocchioConstraints(
        constraints,
        to_scene,
        tuple(name for name, _ in approximated),
        tuple(name for name, joint1 in approximated if joint1 == 0),
        tuple(loops),
        tuple(unsupported),
    )


def _side_by_side(blocks: Sequence[Array | None], bounds: Sequence[AnyBound]) -> Array:
    """Return E^T of all constraints from that of each, None where it is 1."""
    whole = [np.eye(b.size) if E is None else E for E, b in zip(blocks, bounds, strict=True)]
    E_T = np.zeros((sum(len(E) for E in whole), sum(E.shape[1] for E in whole)))
    column = 0
    for bound, E in zip(bounds, whole, strict=True):
        E_T[bound.rows, column : column + E.shape[1]] = E
        column += E.shape[1]
    return E_T


def _equivalent(model: Any, bound: AnyBound) -> tuple[list[PinocchioConstraint], Array | None]:
    """Return what Pinocchio has in place of a constraint, and E^T: None if that is 1.

    Nothing where it has nothing: neither of other rows, nor of rows that follow a path.
    """
    if bound.drive:
        return [], np.zeros((bound.size, 0))
    if isinstance(bound, Bound) and bound.is_plain:
        E_T = None if bound.sign > 0 else -np.eye(bound.size)
        return [PinocchioConstraint.of(bound, bound.size)], E_T
    if isinstance(bound, Bound) and bound.is_hinge:
        ends = bound.lever * np.array([1.0, -1.0])[:, None] * np.eye(3)[bound.axis]
        E = np.vstack([np.hstack([np.eye(3), -pin.skew(d)]) for d in ends])
        points = [PinocchioConstraint.of(bound, 3, d, d) for d in ends]
        return points, bound.sign * E[:, list(bound.selection)].T
    if isinstance(bound, Bound) and bound.is_planar:
        height = _height_of(model, bound)
        if height is not None:
            point = PinocchioConstraint.of(bound, 3, height * np.eye(3)[bound.axis])
            return [point], bound.sign * np.eye(3)[list(bound.selection)]
    return [], np.zeros((bound.size, 0))


def _height_of(model: Any, b: Bound) -> float | None:
    """Return how far c2 is from c1 along the axis of a planar pin [m].

    None if that can change: the pin is one in space then.
    """
    data = whole_data(model)
    anywhere = np.random.default_rng(0).normal(size=model.nv)
    pin.computeJointJacobians(model, data, pin.integrate(model, pin.neutral(model), anywhere))
    c1Mc2 = (data.oMi[b.joint1] * b.placement1).actInv(data.oMi[b.joint2] * b.placement2)

    def twist(joint: int, placement: Any) -> Array:
        if joint == 0:
            return np.zeros((6, model.nv))
        return frame_jacobian(model, data, joint, placement, LOCAL)

    first, second = (
        twist(b.joint1, b.placement1),
        c1Mc2.toActionMatrix() @ twist(b.joint2, b.placement2),
    )
    off = [b.axis, *(3 + i for i in range(3) if i != b.axis)]  # e . T_lin and e x T_ang
    rounding = ROUNDED * (np.abs(first) + np.abs(second)).max(axis=0)
    stays = (np.abs(first - second)[off] <= rounding).all()
    return float(c1Mc2.translation[b.axis]) if stays else None
