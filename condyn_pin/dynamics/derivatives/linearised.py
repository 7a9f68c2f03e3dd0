"""The two equations, linearised: how their residuals change with q and v at fixed a and lam.

    r = M a + h - tau - J^T lam,        s = J a + gamma - a_ref

Newton-Euler's derivatives give those of r with the constraint forces fixed in the axes of their
bodies. What turns, and those of s, come from the constraints:
`condyn_pin.constraints.partials`. A joint whose axes turn with its own
q is taken apart (`in_series`, beside them), or carried by a free body (`carried`).

References
----------
Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import turning
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.partials.rows import ConstraintPartials
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.constraints.rows.equations import Equations, answer_key
from condyn_pin.dynamics.derivatives.carried import Carried, in_series
from condyn_pin.dynamics.raw import weightless

_rnea_derivatives = pin.computeRNEADerivatives  # bound once


class Linearised(NamedTuple):
    """The partial derivatives at one (q, v, a, lam)."""

    J: Array  # (m, nv)
    # -[[r_q, r_v], [s_q, s_v]]: what a step of q and v leaves to solve
    rhs: Array  # (nv + m, 2 nv)
    M: Array | None  # (nv, nv), r by a; None where free bodies carry joints

    @property
    def r_q(self) -> Array:
        """(nv, nv)."""
        n = self.J.shape[1]
        return -self.rhs[:n, :n]

    @property
    def s_q(self) -> Array:
        """(m, nv)."""
        n = self.J.shape[1]
        return -self.rhs[n:, :n]


class Linearisation:
    """The linearised equations of one model with its bound constraints, and their memory.

    `equations` of the same model put the constraint forces on the bodies; they have that done
    already of an answer that they have proved just now, and where the loops are. As their
    `recursion` in that proof, this has Newton-Euler's derivatives done too.
    """

    def __init__(
        self, model: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None = None,
        equations: Equations | None = None,
    ) -> None:  # fmt: skip
        given, self._bounds = model, bounds
        model, bounds = in_series(model, bounds)
        self._carried: Carried | None = None
        self._done = b""  # the answer of which `data` holds Newton-Euler's derivatives
        if model is not given and turning(model):
            self._carried = Carried(model)
            model = self._carried.model
        # in which no axes turn
        self._model, self._data = model, whole_data(model)
        self._hold_views(self._data, model.nv)
        self._of_constraints = ConstraintPartials(model, self._data, bounds, drift)
        self._drift = drift
        self._m = sum(b.size for b in bounds)
        if equations is None or model is not given:
            equations = Equations(model, bounds)
        self._equations, self._given = equations, given

    def at(self, q: Array, v: Array, a: Array, lam: Array) -> Linearised:
        """Return the partial derivatives at a state and an answer."""
        if self._carried is None:
            rhs, J = self._of_bodies(q, v, a, lam)
            M = self._M.copy()  # Newton-Euler's derivatives leave it behind
        else:
            free_q, nu, rate, chain = self._carried.state(q, v, a)
            of_free, J = self._of_bodies(free_q, nu, rate, lam)
            r = self._torques.copy()  # as Newton-Euler's derivatives left it
            by_a = np.vstack([pin.crba(self._model, self._data, free_q), J])
            rhs, J, M = self._carried.back(chain, of_free, -by_a, -r), J @ chain.Phi, None
        self._of_constraints.write_couplings((q, v, a, lam), rhs, J)
        return Linearised(J, rhs, M)

    def _hold_views(self, data: Any, n: int) -> None:
        """Hold what Newton-Euler's derivatives write: to fetch it costs as much as to copy it."""
        # of a single coordinate Pinocchio has vectors
        self._M, self._dtau_dq, self._dtau_dv = (
            part.reshape(n, n) for part in (data.M.T, data.dtau_dq, data.dtau_dv)
        )
        self._torques = data.tau

    @property
    def takes_the_model(self) -> bool:
        """Whether it works on the model that it was given: no axes turn in that."""
        return self._model is self._given

    def newton_euler(self, q: Array, v: Array, a: Array, wrenches: Any, answer: bytes) -> Array:
        """Return M a + h less what wrenches do; `at` finds the derivatives of the answer done."""
        _rnea_derivatives(self._model, self._data, q, v, a, wrenches)
        self._done = answer
        return self._torques  # type: ignore[no-any-return]

    def mass(self, q: Array) -> Array | None:
        """Return M if `newton_euler` has left it behind at q, where it stands."""
        return self._M if self._done.startswith(q.tobytes()) else None

    def _of_bodies(self, q: Array, v: Array, a: Array, lam: Array) -> tuple[Array, Array]:
        """Return what a step leaves to solve and J, but for couplings, where no axes turn."""
        n, equations = self._model.nv, self._equations
        answer = answer_key(q, v, a, lam)
        proved = answer == equations.answer
        if self._done != answer:
            # it leaves behind all that the derivatives of frames read
            wrenches = equations.on_joints if proved else equations.wrenches_at(q, lam)
            self.newton_euler(q, v, a, wrenches, answer)
        self._done = b""  # for one call
        make, pulls = self._of_constraints.make, np.negative(self._dtau_dq)
        rhs, J = make((n + self._m, 2 * n)), make((self._m, n))
        ends = equations.ball_ends if proved else None
        self._of_constraints.write(lam, pulls, rhs[n:], J, ends)
        # what is contiguous is added to, and copied, in half the time
        rhs[:n, :n], rhs[:n, n:] = pulls, np.negative(self._dtau_dv)
        if self._drift:
            rhs[n:, n:] -= self._drift.Kd * J
        return rhs, J

    def turning(self, q: Array, w: Array) -> Array:
        """Return how J w changes with q (m, nv) while w (nv,) stays; at w = v, how J v changes."""
        if self._carried is None:
            of_rows = self._velocity_by_q(q, w)
        else:
            free_q, nu, still, chain = self._carried.state(q, w, np.zeros_like(w))
            _, J = self._of_bodies(free_q, nu, still, np.zeros(self._m))
            of_rows = self._velocity_by_q(free_q, nu) @ chain.Phi + J @ chain.v_q
        self._of_constraints.turn_couplings(q, w, of_rows)
        return of_rows

    def pulling(self, q: Array, z: Array) -> Array:
        """Return how J^T z changes with q (nv, nv) while z (m,) stays."""
        still = np.zeros(self._given.nv)
        return -self._weightless.at(q, still, still, z).r_q

    @cached_property
    def _weightless(self) -> Linearisation:
        """The same without gravity: at rest no torques change with q but those of the rows."""
        return Linearisation(weightless(self._given), self._bounds)

    def _velocity_by_q(self, q: Array, w: Array) -> Array:
        """Return the partials of J w by q, where no axes turn."""
        self._done = b""
        _rnea_derivatives(self._model, self._data, q, w, np.zeros_like(w))
        of_rows = np.zeros((self._m, self._model.nv))
        self._of_constraints.turning(of_rows)
        return of_rows

    def by_frame(
        self, q: Array, v: Array, a: Array, lam: Array, name: str, end: int
    ) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of c1 or c2 of a constraint, in its axes.

        The frame moves as if a joint held it: its velocity turns by -x x v, and its wrench goes
        along. The end that stays has no part in it.
        """
        chain = None
        if self._carried:
            q, v, a, chain = self._carried.state(q, v, a)
        self._done = b""
        pin.computeForwardKinematicsDerivatives(self._model, self._data, q, v, a)
        r, s = self._of_constraints.by_frame(name, lam, end)
        return (chain.Phi.T @ r if chain else r), s
