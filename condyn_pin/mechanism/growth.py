"""Growth vector: to how many places the allowed velocities lead, one after the other.

With X_1 ... X_k fields of velocities that the rows allow, A X = 0, the spaces

    D_1 = span X_i,        D_(j+1) = D_j + [D_1, D_j],        [X, Y] = dY X - dX Y + {X, Y}

grow until no bracket leads out of them. Their dimensions are the growth vector. By Chow's theorem
every configuration nearby within the last of them can be reached: a unicycle, (2, 3, 4), parks; a
blade gets sideways; and where the first is the last, rows are integrable (`is_integrable`).

The fields are smooth, the columns of 1 - A^+ A, and their derivatives are differences of order 4
in the coordinates of the joints; {X, Y} is the bracket of the joints' own groups, that of twists
for a free-flyer.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg import rank_of
from condyn_pin.dynamics.scene import Scene, check_not_driven, check_scene
from condyn_pin.mechanism.check import check
from condyn_pin.mechanism.closing import Closer
from condyn_pin.mechanism.integrability import bracket, is_integrable

# A field of velocities in the axes of the joints: q -> (nv,)
Field = Callable[[Array], Array]

# Step of the differences, and their weights: off by h^4, and by eps / h a bracket.
_STEP: Final = 1e-2
_STENCIL: Final = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


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
    check_scene(scene)
    check_not_driven(scene, "growth_vector")
    check_count("deepest", deepest)
    model = scene.robot.model
    scene.robot.check_unedited()
    q_ = scene.nominal.q if q is None else normalised(model, "q", q)
    check(scene, q_, None).raise_if_open()
    allowed = _Allowed(scene)
    if is_integrable(scene, q_):  # exact, and far cheaper than differences of all brackets
        return (model.nv - allowed.rank,)
    first = [allowed.field(i) for i in allowed.chosen(q_)]
    level, sizes, spanned = first, [len(first)], _Span(model.nv)
    for X in first:
        spanned.grows_by(X(q_))
    while len(sizes) < deepest and sizes[-1] < allowed.most(q_):
        # a level that brings nothing at a singular place may have brackets that do
        pairs = product(first, level) if len(sizes) > 1 else combinations(first, 2)
        level = [allowed.bracket(X, Y) for X, Y in pairs]
        for Z in level:
            spanned.grows_by(Z(q_))
        sizes.append(len(spanned.basis))
    while len(sizes) > 1 and sizes[-1] == sizes[-2]:
        sizes.pop()
    return tuple(sizes)


class _Span:
    """A space that grows; `basis` is orthonormal, a vector a row."""

    def __init__(self, n: int) -> None:
        self.basis = np.zeros((0, n))

    def grows_by(self, z: Array) -> bool:
        """Take a vector in, and return whether it leads out of what there was."""
        out = z - self.basis.T @ (self.basis @ z)
        size = float(np.linalg.norm(out))
        if size <= tolerances.GROWN * max(1.0, float(np.linalg.norm(z))):
            return False
        self.basis = np.vstack([self.basis, out / size])
        return True


class _Allowed:
    """The fields of allowed velocities of one scene, X_i(q) = (1 - A^+ A) e_i.

    Brackets of brackets ask for the same fields at the same places again: what is known is kept.
    """

    def __init__(self, scene: Scene) -> None:
        self._model, self._closer = scene.robot.model, Closer.of(scene)
        self.rank = scene.nominal.rank
        self._projectors: dict[bytes, Array] = {}

    def most(self, q: Array) -> int:
        """Return what rows with a position leave: no bracket leads out of that."""
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

        def along(q: Array, x: Array, Z: Field) -> Array:
            ends = (share / _STEP * Z(self._moved(q, k * _STEP * x)) for k, share in _STENCIL)
            return np.asarray(sum(ends))

        known: dict[bytes, Array] = {}

        def found(q: Array) -> Array:
            z = known.get(place := q.tobytes())
            if z is None:
                x, y = X(q), Y(q)
                z = along(q, x, Y) - along(q, y, X) + bracket(self._model, x, y)
                known[place] = z
            return z

        return found

    def _moved(self, q: Array, dq: Array) -> Array:
        """Return q moved, and closed again: off its own manifold a loop says nothing."""
        q = np.array(pin.integrate(self._model, q, dq))
        return self._closer.close(q).q if len(self._closer.rows) else q
