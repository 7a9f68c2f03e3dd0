"""Controllability: to how many places allowed velocities and torques lead, by Lie brackets.

With X_1 ... X_k fields of velocities that the rows allow, A X = 0, the spaces

    D_1 = span X_i,        D_(j+1) = D_j + [D_1, D_j],        [X, Y] = dY X - dX Y + {X, Y}

grow until no bracket leads out of them. Their dimensions are the growth vector. By Chow's theorem
every configuration nearby within the last of them can be reached: a unicycle, (2, 3, 4), parks; a
blade gets sideways; and where the first is the last, rows are integrable (`is_integrable`).

That is where each allowed velocity can be had. From rest, under torques tau = B u, accelerations
come first: with Y_i what the i-th input does to the machine at rest, and S(q, v) the acceleration
without torques and gravity,

    <X : Y> = dX Y + dY X - S(q, X + Y) + S(q, X) + S(q, Y)

is what two of them do one after the other (symmetric product). The places that can be reached are
those of the brackets of all Y and their repeated symmetric products (Lewis and Murray 1997).

The fields are smooth, the columns of 1 - A^+ A, and their derivatives are differences of order 4
in the coordinates of the joints; {X, Y} is the bracket of the joints' own groups, that of twists
for a free-flyer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement, product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import rank_of
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.dynamics.scene import Scene, check_not_driven, check_scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.classification import bracket, is_integrable
from condyn_pin.mechanism.closing import LoopCloser
from condyn_pin.mechanism.rank import check

# A field of velocities in the axes of the joints: q -> (nv,)
Field = Callable[[Array], Array]

# Step of the differences, and their weights: off by h^4, and by eps / h a bracket.
_STEP: Final = 1e-2
_STENCIL: Final = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


@dataclass(frozen=True)
class Controllability:
    """Rank of the Lie algebra of a scene at a place, and what follows from it.

    Attributes
    ----------
    growth : tuple of int
        Growth vector of the velocities, or of what torques begin: dimensions of the spaces that
        their brackets span, level after level.
    dimension : int
        Of the set of configurations that rows with a position leave.
    allowed, driven : int
        Dimension of the allowed velocities, and how many of them the inputs begin.
    deepest : int
        Levels that were computed.
    """

    growth: tuple[int, ...]
    dimension: int
    allowed: int
    driven: int
    deepest: int

    @property
    def accessible(self) -> bool:
        """True if brackets span all directions: the rank condition holds at this place.

        False up to the levels that were computed.
        """
        return self.growth[-1] == self.dimension

    @property
    def controllable(self) -> bool | None:
        """True if every place nearby can be reached (Chow), False if the rank condition fails.

        None if it holds, and inputs begin fewer velocities than rows allow: the set of places that
        can be reached has an inside, and rank alone does not tell on which side of it the start is.
        """
        if not self.accessible:
            return False
        return True if self.driven == self.allowed else None

    def __str__(self) -> str:
        spans = f"growth vector {self.growth} of {self.dimension}"
        if not self.accessible:
            return f"not controllable by brackets of {self.deepest} levels: {spans}"
        if self.controllable:
            return f"controllable: {spans}"
        return f"accessible, {self.driven} of {self.allowed} velocities driven: {spans}"


@one_blas_thread
def controllability(
    scene: Scene,
    q: ArrayLike | None = None,
    *,
    torques: ArrayLike | None = None,
    deepest: int = 4,
) -> Controllability:
    """Decide by the rank of brackets which places nearby a scene can be driven to.

    rank of all brackets of the inputs at q = dimension of the configurations

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like, optional
        A closed configuration; the nominal state by default.
    torques : (nv, k) or (nv,) array_like, optional
        Directions of the inputs: torques tau = torques @ u [1], from rest, such as
        ``control.Actuation(robot).B``. By default each allowed velocity is an input.
    deepest : int
        The most levels to compute, as in `growth_vector`. Of torques these are degrees of symmetric
        products, and then as many of brackets: 3 is mostly enough.

    Returns
    -------
    Controllability

    Raises
    ------
    InvalidArgument
        If `q` or `torques` has a wrong size or is not finite, `deepest` is no positive number, or
        gravity moves the machine from rest at q: drift has no part in these brackets.
    NotAssembled
        If a loop is open at q.
    UnsupportedConstraint
        If constraints are driven.

    Notes
    -----
    The rank is computed from differences: a direction smaller than 1e-5 counts as rounding. Each
    level costs ten times the one before.

    References
    ----------
    Chow. Über Systeme von linearen partiellen Differentialgleichungen erster Ordnung. Mathematische
    Annalen 117, 1939.
    Lewis, Murray. Configuration controllability of simple mechanical control systems. SIAM Journal
    on Control and Optimization 35, 1997.
    """
    if torques is None:
        growth = growth_vector(scene, q, deepest=deepest)
        fields, q_ = _AllowedFields(scene), _place(scene, q)
        return Controllability(growth, fields.most(q_), growth[0], growth[0], deepest)
    q_ = _checked(scene, q, "controllability", deepest)
    nv = scene.robot.nv
    B = np.asarray(torques)
    B = B if B.ndim == 2 else B.reshape(-1, 1)
    B = finite("torques", B, (nv, B.shape[1]))
    fields = _DrivenFields(scene, B)
    if np.abs(fields.fall(q_)).max() > tolerances.GROWN * tolerances.GRAVITY:
        raise InvalidArgument(
            "q: gravity moves the machine from rest there, and these brackets are of machines that "
            "stay where they are without torques: choose an equilibrium, or a level plane"
        )
    inputs = [fields.input(i) for i in range(B.shape[1])]
    levels, basis, chosen = [inputs], np.zeros((0, nv)), list[Field]()
    driven = 0
    for degree in range(1, deepest + 1):
        if degree > 1:
            levels.append(fields.products(levels, degree))
        for X in levels[-1]:  # a basis at q of what torques begin
            basis, before = _with_vector(basis, X(q_)), len(basis)
            chosen += [X] * (len(basis) - before)
        driven = driven or len(basis)
        if len(basis) == nv - fields.rank:
            break
    growth = _grown(fields, q_, chosen, deepest) if chosen else (0,)
    return Controllability(growth, fields.most(q_), nv - fields.rank, driven, deepest)


def lie_bracket(scene: Scene, X: Field, Y: Field, q: ArrayLike) -> Array:
    """Lie bracket of two fields of velocities at q: where moving along X, Y and back leads.

    [X, Y] = dY X - dX Y + {X, Y},    {X, Y} the bracket of the joints' own groups

    Parameters
    ----------
    scene : Scene
        Whose loops stay closed along the fields.
    X, Y : callable
        Velocities (nv,) in the axes of the joints at q (nq,); smooth.
    q : (nq,) array_like
        A closed configuration.

    Returns
    -------
    Z : (nv,) array
        By differences of order 4 [m/s^2, rad/s^2].

    Raises
    ------
    InvalidArgument
        If `q` or a field has a wrong size or is not finite.
    NotAssembled
        If a loop is open at q.
    UnsupportedConstraint
        If constraints are driven.
    """
    q_ = _checked(scene, q, "lie_bracket", 1)
    nv = scene.robot.nv
    one, two = ((lambda at, Z=Z: finite("X, Y: velocity", Z(at.copy()), nv)) for Z in (X, Y))
    return _AllowedFields(scene).bracket(one, two)(q_)


@one_blas_thread
def growth_vector(scene: Scene, q: ArrayLike | None = None, *, deepest: int = 4) -> tuple[int, ...]:
    """Return the dimensions that allowed velocities and their repeated Lie brackets span.

    D_(j+1) = D_j + [D_1, D_j], until it no longer grows

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like, optional
        A closed configuration; the nominal state by default.
    deepest : int
        The most levels to compute: a car with n trailers has 3 + n. Each costs 4 d times the one
        before, d being the first dimension. At singular places a level may bring nothing, and the
        next more.

    Returns
    -------
    tuple of int
        The growth vector. Its first entry is the mobility at q; its last one the dimension of the
        set of places that can be reached nearby (Chow), if fewer than `deepest` levels were needed.
        A single entry: the rows restrict the position.

    Raises
    ------
    InvalidArgument
        If `q` has a wrong size or is not finite, or `deepest` is no positive number.
    NotAssembled
        If a loop is open at q.
    UnsupportedConstraint
        If constraints are driven: what a path leads to is not in the brackets.

    Notes
    -----
    The rank is computed from differences: a direction smaller than 1e-5 counts as rounding.

    References
    ----------
    Chow. Über Systeme von linearen partiellen Differentialgleichungen erster Ordnung. Mathematische
    Annalen 117, 1939.
    Murray, Li, Sastry. A Mathematical Introduction to Robotic Manipulation. CRC Press, 1994,
    chapters 7 and 8.
    """
    q_ = _checked(scene, q, "growth_vector", deepest)
    allowed = _AllowedFields(scene)
    if is_integrable(scene, q_):  # exact, and far cheaper than differences of all brackets
        return (scene.robot.nv - allowed.rank,)
    first = [allowed.field(i) for i in allowed.chosen(q_)]
    return _grown(allowed, q_, first, deepest)


def _checked(scene: Scene, q: ArrayLike | None, what: str, deepest: int) -> Array:
    """Configuration of a user, or the nominal one, at which all loops are closed."""
    check_scene(scene)
    check_not_driven(scene, what)
    check_count("deepest", deepest)
    scene.robot.check_unedited()
    q_ = _place(scene, q)
    check(scene, q_, None).raise_if_open()
    return q_


def _place(scene: Scene, q: ArrayLike | None) -> Array:
    return scene.nominal.q if q is None else normalised(scene.robot.model, "q", q)


def _grown(fields: _AllowedFields, q: Array, first: list[Field], deepest: int) -> tuple[int, ...]:
    """Dimensions of the spaces that fields and their repeated brackets span."""
    basis = _span(q, first, np.zeros((0, len(first[0](q)))))
    level, sizes = first, [len(basis)]
    while len(sizes) < deepest and sizes[-1] < fields.most(q):
        # a level that brings nothing at a singular place may have brackets that do
        pairs = product(first, level) if len(sizes) > 1 else combinations(first, 2)
        level = [fields.bracket(X, Y) for X, Y in pairs]
        basis = _span(q, level, basis)
        sizes.append(len(basis))
    while len(sizes) > 1 and sizes[-1] == sizes[-2]:
        sizes.pop()
    return tuple(sizes)


def _span(q: Array, fields: Sequence[Field], basis: Array) -> Array:
    """Orthonormal basis, a vector a row, of a space and of fields at q."""
    for X in fields:
        basis = _with_vector(basis, X(q))
    return basis


def _with_vector(basis: Array, z: Array) -> Array:
    """Orthonormal basis, a vector a row, of the space with z besides, if z leads out of it."""
    out = z - basis.T @ (basis @ z)
    size = float(np.linalg.norm(out))
    is_in = size <= tolerances.GROWN * max(1.0, float(np.linalg.norm(z)))
    return basis if is_in else np.vstack([basis, out / size])


class _AllowedFields:
    """The fields of allowed velocities of one scene, X_i(q) = (1 - A^+ A) e_i.

    Brackets of brackets need the same fields at the same places again: what is known is kept.
    """

    def __init__(self, scene: Scene) -> None:
        self._model, self._closer = scene.robot.model, LoopCloser.of(scene)
        self.rank = scene.nominal.rank
        self._projectors: dict[bytes, Array] = {}

    def most(self, q: Array) -> int:
        """Return the dimension that rows with a position leave: no bracket leads out of it."""
        J = self._closer.equations.jacobian(q)[self._closer.rows]
        return int(self._model.nv) - (rank_of(np.linalg.svd(J, compute_uv=False)) if len(J) else 0)

    def projector(self, q: Array) -> Array:
        """Return 1 - A^+ A (nv, nv)."""
        P = self._projectors.get(place := q.tobytes())
        if P is None:
            V = np.linalg.svd(self._closer.equations.jacobian(q))[2][: self.rank]
            P = self._projectors[place] = np.eye(self._model.nv) - V.T @ V
        return P

    def chosen(self, q: Array) -> list[int]:
        """Return the joints whose fields are a basis at q: the largest of what is left, in turn."""
        P, found = self.projector(q), []
        for _ in range(self._model.nv - self.rank):
            i = int(np.argmax(np.linalg.norm(P, axis=0)))
            found.append(i)
            along = P[:, i] / np.linalg.norm(P[:, i])
            P = P - np.outer(along, along @ P)
        return found

    def field(self, i: int) -> Field:
        """Return X_i."""
        return lambda q: self.projector(q)[:, i]

    def bracket(self, X: Field, Y: Field) -> Field:
        """Return [X, Y]."""

        def found(q: Array) -> Array:
            x, y = X(q), Y(q)
            return self._along(q, x, Y) - self._along(q, y, X) + bracket(self._model, x, y)

        return _kept(found)

    def _along(self, q: Array, x: Array, Z: Field) -> Array:
        """Derivative of a field along a velocity."""
        ends = (share / _STEP * Z(self._moved(q, k * _STEP * x)) for k, share in _STENCIL)
        return np.asarray(sum(ends))

    def _moved(self, q: Array, dq: Array) -> Array:
        """Return q moved, and closed again: off its own manifold a loop says nothing."""
        q = np.array(pin.integrate(self._model, q, dq))
        return self._closer.close(q).q if len(self._closer.rows) else q


class _DrivenFields(_AllowedFields):
    """The fields of what torques begin, Y_i = (M^-1 within the rows) B_i, and their products."""

    def __init__(self, scene: Scene, B: Array) -> None:
        super().__init__(scene)
        self._B, self._equations = B, self._closer.equations

    def input(self, i: int) -> Field:
        """Return Y_i."""
        return _kept(lambda q: self._answer(q, 0.0 * self._B[:, i], self._B[:, i]))

    def fall(self, q: Array) -> Array:
        """Return the acceleration (nv,) of the machine at rest, without torques."""
        still = np.zeros(len(self._B))
        return self._answer(q, still, -self._equations.terms(q, still).h)

    def products(self, levels: list[list[Field]], degree: int) -> list[Field]:
        """Return the symmetric products of a degree, of those of lower degrees."""
        found = []
        for low in range(1, degree // 2 + 1):
            one, two = levels[low - 1], levels[degree - low - 1]
            pairs = combinations_with_replacement(one, 2) if one is two else product(one, two)
            found += [self.product(X, Y) for X, Y in pairs]
        return found

    def product(self, X: Field, Y: Field) -> Field:
        """Return <X : Y>."""

        def found(q: Array) -> Array:
            x, y, none = X(q), Y(q), np.zeros(len(self._B))
            bend = self._answer(q, x + y, none) - self._answer(q, x, none)
            bend -= self._answer(q, y, none)
            return self._along(q, x, Y) + self._along(q, y, X) - bend

        return _kept(found)

    def _answer(self, q: Array, v: Array, tau: Array) -> Array:
        """Acceleration (nv,) at an allowed velocity under torques, gravity held."""
        terms = self._equations.terms(q, v)
        held = self._equations.terms(q, 0.0 * v).h
        V = np.linalg.svd(terms.J)[2] if len(terms.J) else np.eye(len(v))
        N = V[self.rank :].T
        a_0 = -np.linalg.pinv(terms.J, rcond=tolerances.RANK) @ terms.gamma
        left = tau - (terms.h - held) - terms.M @ a_0
        return np.asarray(a_0 + N @ np.linalg.solve(N.T @ terms.M @ N, N.T @ left))


def _kept(field: Field) -> Field:
    """Field whose values are kept: brackets of brackets need them at the same places again."""
    known: dict[bytes, Array] = {}

    def found(q: Array) -> Array:
        z = known.get(place := q.tobytes())
        if z is None:
            z = known[place] = field(q)
        return z

    return found
