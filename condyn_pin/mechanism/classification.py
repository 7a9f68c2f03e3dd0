"""Classification of constraints: those on positions, and those on velocities only.

Classification: what kind of system a scene is, in the words of analytical mechanics.

    holonomic       all rows restrict the position, c(q, t) = 0, or are rates of what does
    scleronomic     time is in none of them; rheonomic if it is
    bilateral       J v = 0 both ways; unilateral if a contact may open
    LICQ            the rows are independent: lam is unique

The index of the equations is how often they have to be differentiated before a and lam can be
solved for, and once more: 3 with c(q) = 0, 2 with A v = 0, 1 with J a + gamma = 0, and 0 for an
ordinary differential equation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import null_space
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.dynamics.derivatives.kkt import Linearisation
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembling import assemble, nominal_configuration
from condyn_pin.mechanism.rank import Rank, check


@dataclass(frozen=True)
class Classification:
    """Kind of system that a scene is: holonomic or not, driven or not, with contacts or not.

    Attributes
    ----------
    holonomic : bool or None
        Whether the rows restrict the position, and not the velocity alone; None if loops are open,
        so that it cannot be told.
    rheonomic : bool
        Whether time is in some rows: they follow a path.
    unilateral : bool
        Whether contacts may open.
    rows, velocity_rows, rank : int
        All rows; those without a position; independent ones.
    """

    holonomic: bool | None
    rheonomic: bool
    unilateral: bool
    rows: int
    velocity_rows: int
    rank: int

    @property
    def licq(self) -> bool:
        """True if all rows are independent: linear independence constraint qualification."""
        return self.rank == self.rows

    @property
    def index(self) -> int:
        """Index of the differential-algebraic equations as they are posed, before J a + gamma."""
        if not self.rows:
            return 0
        return 2 if self.velocity_rows == self.rows else 3

    def __str__(self) -> str:
        if not self.rows:
            return "unilateral contacts only" if self.unilateral else "no constraints: an ODE"
        kinds = {True: "holonomic", False: "nonholonomic", None: "holonomic or not: loops are open"}
        words = [
            kinds[self.holonomic],
            "rheonomic" if self.rheonomic else "scleronomic",
            "bilateral, with unilateral contacts" if self.unilateral else "bilateral",
            "independent rows (LICQ)" if self.licq else f"rank {self.rank} of {self.rows} rows",
            f"DAE of index {self.index}",
        ]
        return ", ".join(words)


def classification(scene: Scene, rank: Rank) -> Classification:
    """Return the kind of system of a scene at a configuration whose rank is known."""
    # a contact that belongs where it is has no gap either, but holds the position
    velocity_rows = sum(
        bound.size - len(bound.positioned)
        for constraint, bound in zip(scene.constraints, scene.bounds, strict=True)
        if constraint.on_velocity
    )
    holonomic: bool | None = True
    if velocity_rows:
        try:
            holonomic = is_integrable(scene, rank.q)
        except NotAssembled:
            holonomic = None
    return Classification(
        holonomic=holonomic,
        rheonomic=scene.is_driven,
        unilateral=bool(scene.contacts),
        rows=rank.rows,
        velocity_rows=velocity_rows,
        rank=rank.rank,
    )


# Integrability: whether constraints on the velocity are constraints on the position.
#
# Let X and Y be velocities that the rows allow, A X = A Y = 0, constant in the axes of the joints.
# Moving along X, then Y, and back leads to second order along the Lie bracket
#
#     d(X, Y) = (dA X) Y - (dA Y) X - A [X, Y],
#
# which has to stay within the rows for every X and Y, at every configuration nearby: then, and only
# then (Frobenius), the rows are the rates of as many functions of q. A blade fails: by turning and
# gliding it gets sideways.
#
# d is the exterior derivative of the rows; with one velocity filled in it is their `curvature`.
#
# dA is exact, from `condyn_pin.dynamics.derivatives.kkt`: with v = 0 and a = Y, J a + gamma = A Y.
# [X, Y] is the bracket of the joints' own groups: for a free-flyer the cross product of its twists,
# and zero for every joint whose q is a plain vector.


_LOOKS = 2  # at configurations nearby: a bracket may vanish at one by accident
_NEARBY = 0.1  # [rad, m]

# What a velocity is in the axes of a twist (linear, angular), for joints whose q is no vector.
_TWISTS: Final[dict[str, tuple[int, ...]]] = {
    "JointModelFreeFlyer": (0, 1, 2, 3, 4, 5),
    "JointModelSpherical": (3, 4, 5),
    "JointModelPlanar": (0, 1, 5),
}


@one_blas_thread
def is_integrable(scene: Scene, q: ArrayLike | None = None) -> bool:
    """True if the rows of a scene restrict the position, and not only the velocity.

    d(X, Y) = 0 for all X, Y with A X = A Y = 0, at q and at two closed configurations near it.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like, optional
        A closed configuration; the nominal state by default.

    Returns
    -------
    bool
        True for loops and contacts, and for a scene without rows; False if some of the velocities
        that the rows allow lead, one after the other, to where no allowed velocity leads.

    Raises
    ------
    InvalidArgument
        If `scene` is no scene, or `q` has a wrong size or is not finite.
    NotAssembled
        If a loop is open at q: off the constraint manifold the question has no meaning.

    Notes
    -----
    Where some rows are integrable and others are not, the answer is False. Cost: one linearisation
    for each degree of freedom left, three times.

    References
    ----------
    Murray, Li, Sastry. A Mathematical Introduction to Robotic Manipulation. CRC Press, 1994,
    chapter 7.
    """
    check_scene(scene)
    model = scene.robot.model
    scene.robot.check_unedited()
    q_ = nominal_configuration(scene) if q is None else normalised(model, "q", q)
    check(scene, q_, None).raise_if_open()
    if not scene.rows:
        return True
    of = Linearisation(model, scene.bounds)
    return all(_is_involutive(model, scene.rows, of, each) for each in _at_and_near(scene, q_))


@one_blas_thread
def curvature(scene: Scene, q: ArrayLike, v: ArrayLike) -> Array:
    """Return the curvature K of the rows along a velocity: zero for rates of functions of q.

    K_ij = d_i(v, e_j) = ((dA v) e_j - (dA e_j) v - A [v, e_j])_i,        A' = dA v

    For holonomic rows K w is zero for all velocities w with A w = 0. If it is not, two principles
    disagree: with forces A^T lam that do no work (d'Alembert) a machine moves by M a + h = tau +
    A^T lam. A motion that makes the action stationary among those that the rows allow (vakonomic,
    known from optimal control) obeys

        M a + h = tau + A^T lam - K^T mu,        mu' = -lam,

    which real machines do not.

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array_like
        Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear first.

    Returns
    -------
    K : (m, nv) array
        Rows in the order of the scene, columns in the axes of the joints: K^T mu is a torque or a
        force for mu [N s, N m s], so that entries are in 1/s, and in m/s where they turn forces
        into moments.

    Raises
    ------
    InvalidArgument
        If `q` or `v` has a wrong size or is not finite.

    Notes
    -----
    Cost: nv + 2 linearisations.

    References
    ----------
    Lewis, Murray. Variational principles for constrained systems: theory and experiment.
    International Journal of Non-Linear Mechanics 30, 1995.
    """
    check_scene(scene)
    model = scene.robot.model
    scene.robot.check_unedited()
    q_, v_ = normalised(model, "q", q), finite("v", v, model.nv)
    return curvature_by(Linearisation(model, scene.bounds), model, q_, v_, scene.rows)


def curvature_by(of: Linearisation, model: Any, q: Array, v: Array, rows: int) -> Array:
    """Curvature K (rows, nv) in the memory of a linearisation, without checks."""
    still, no_force = np.zeros(model.nv), np.zeros(rows)
    by_v = of.at(q, still, v, no_force)
    A, turned = np.array(by_v.J), np.array(by_v.s_q)
    columns = [
        of.at(q, still, e, no_force).s_q @ v - turned[:, j] - A @ bracket(model, v, e)
        for j, e in enumerate(np.eye(model.nv))
    ]
    return np.array(columns).T.reshape(rows, model.nv)


def _at_and_near(scene: Scene, q: Array) -> Iterator[Array]:
    """Yield q, and what can be closed near it."""
    yield q
    rng, model = np.random.default_rng(0), scene.robot.model
    for _ in range(_LOOKS):
        near = np.array(pin.integrate(model, q, _NEARBY * rng.normal(size=model.nv)))
        found = assemble(scene, near, within_limits=False, branch={}, throw=False)
        if found.status.ok:
            yield found.q


def _is_involutive(model: Any, rows: int, linearisation: Linearisation, q: Array) -> bool:
    """True if the brackets of the allowed velocities are allowed, at one configuration."""
    still, no_force = np.zeros(model.nv), np.zeros(rows)
    A = linearisation.at(q, still, still, no_force).J
    allowed = null_space(A)
    # turned[j] @ x = (dA x) y_j
    turned = [linearisation.at(q, still, y, no_force).s_q for y in allowed]
    size = max((float(np.abs(each).max(initial=0.0)) for each in turned), default=0.0)
    size = max(size, float(np.abs(A).max(initial=0.0)))
    for j, y in enumerate(allowed):
        for i, x in enumerate(allowed[:j]):
            d = turned[j] @ x - turned[i] @ y - A @ bracket(model, x, y)
            if np.abs(d).max(initial=0.0) > tolerances.INTEGRABLE * size:
                return False
    return True


def bracket(model: Any, x: Array, y: Array) -> Array:
    """Return [x, y] (nv,) of two velocities that are constant in the axes of the joints."""
    found = np.zeros(model.nv)
    for joint in list(model.joints)[1:]:
        _bracket(joint, int(joint.idx_v), x, y, found)
    return found


def _bracket(joint: Any, start: int, x: Array, y: Array, found: Array) -> None:
    """Write the part of one joint that begins at a velocity index."""
    name = joint.shortname()
    at = slice(start, start + int(joint.nv))
    if name == "JointModelComposite":
        joint = joint.extract() if hasattr(joint, "extract") else joint
        for part in joint.joints:
            _bracket(part, start, x, y, found)
            start += int(part.nv)
    elif name in _TWISTS:
        chosen = list(_TWISTS[name])
        twist_x, twist_y = np.zeros((2, 6))
        twist_x[chosen], twist_y[chosen] = x[at], y[at]
        found[at] = pin.Motion(twist_x).cross(pin.Motion(twist_y)).vector[chosen]
    elif joint.nv > 1 and joint.nq != joint.nv:
        raise InvalidArgument(f"scene: the Lie bracket of a {name} is not known")
