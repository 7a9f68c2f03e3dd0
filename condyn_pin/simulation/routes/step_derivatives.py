"""StepDerivatives: how the end of a step with contacts changes with its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin.contact.problem import MODES, OPEN, ContactProblem, contact_modes
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.simulation.integrators.contact_scheme import AT_REST
from condyn_pin.simulation.routes.columns import Columns
from condyn_pin.simulation.routes.law import Law

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
    from condyn_pin.simulation.integrators.posed import Posed
    from condyn_pin.simulation.remarks import Note
    from condyn_pin.simulation.routes.base import Route
    from condyn_pin.simulation.routes.linear_steps import Ended, LinearSteps


@dataclass(frozen=True, eq=False, repr=False)
class StepDerivatives:
    """The derivatives of q+ and v+, the end of a step; columns and rows of q are tangent.

    Column i by q is the derivative along ``pin.integrate(model, q, t e_i)``, and row i of that of
    q+ is what ``pin.difference(model, q+, ...)`` has there. v+ is in the axes in which the step
    ends.

    Attributes
    ----------
    q, v : (nq,), (nv,) array
        The end of the step that is differentiated: that of the route's own law of contacts.
    modes : dict of str to str
        Of each contact: open, stick or slide.
    margin : float
        How far the nearest contact is from another mode, in units of the contact problem [1].
    route : Route
    names : tuple of str
        The contacts with friction: the columns by friction and by restitution.
    parameters : tuple of str
        What there are derivatives by, beside q, v and tau.
    matrices : tuple of (nv, columns) array
        q+ and v+ by q, v, tau, friction, restitution and solref, side by side [mixed], and by
        inertias if they were asked for.
    notes : tuple of Note
        Why the derivatives are those of a rule, or of one side: Coulomb's law does not determine
        velocities, contacts share an impact in several ways, or pushes give way to each other.
    """

    q: Array
    v: Array
    modes: dict[str, str]
    margin: float
    route: Route
    names: tuple[str, ...]
    matrices: tuple[Array, Array]  # of q+ and of v+, (nv, columns) each
    parameters: tuple[str, ...]
    notes: tuple[Note, ...] = ()

    @property
    def one_sided(self) -> bool:
        """Whether the derivative holds on one side only, or by a rule.

        A contact is so near to another mode, or `notes` say why.
        """
        return self.margin < tolerances.SWITCHES

    @property
    def notices(self) -> tuple[str, ...]:
        """What deserves attention, a sentence each."""
        return tuple(note.text for note in self.notes)

    @property
    def dq_dq(self) -> Array:
        """q+ by q (nv, nv)."""
        return self.matrices[0][:, self.columns.q]

    @property
    def dq_dv(self) -> Array:
        """q+ by v (nv, nv)."""
        return self.matrices[0][:, self.columns.v]

    @property
    def dq_dtau(self) -> Array:
        """q+ by the torques (nv, nv)."""
        return self.matrices[0][:, self.columns.tau]

    @property
    def dv_dq(self) -> Array:
        """v+ by q (nv, nv)."""
        return self.matrices[1][:, self.columns.q]

    @property
    def dv_dv(self) -> Array:
        """v+ by v (nv, nv)."""
        return self.matrices[1][:, self.columns.v]

    @property
    def dv_dtau(self) -> Array:
        """v+ by the torques (nv, nv)."""
        return self.matrices[1][:, self.columns.tau]

    @property
    def dv_dfriction(self) -> Array:
        """v+ by the friction of each contact (nv, k)."""
        self._check("friction")
        return self.matrices[1][:, self.columns.friction]

    @property
    def dv_drestitution(self) -> Array:
        """v+ by the restitution of each contact (nv, k), of schemes that let them rebound."""
        self._check("restitution")
        return self.matrices[1][:, self.columns.restitution]

    @property
    def dv_dsolref(self) -> Array:
        """v+ by the two numbers of `solref` (nv, 2), of schemes and routes that have them."""
        self._check("solref")
        return self.matrices[1][:, self.columns.solref]

    @property
    def dv_dinertias(self) -> Array:
        """v+ by what bodies weigh (nv, 10 a joint), if ``wrt`` had "inertias".

        In the order of `KktDerivatives.by_inertias`: mass, mass times centre of mass, and the
        inertia about the joint's origin xx xy yy xz yz zz.
        """
        self._check("inertias")
        return self.matrices[1][:, self.columns.inertias]

    def by(self, parameter: str) -> Array:
        """Return (q+, v+) by a parameter (2 nv, k), one of `parameters`; q+ in the tangent."""
        self._check(parameter)
        return np.vstack(self.matrices)[:, self.columns.of(parameter)]

    def jvp(self, dq: ArrayLike, dv: ArrayLike, dtau: ArrayLike) -> tuple[Array, Array]:
        """Return (dq+, dv+) along dq, dv and dtau, each (nv,)."""
        n = len(self.v)
        x = np.concatenate([finite(*each, n) for each in (("dq", dq), ("dv", dv), ("dtau", dtau))])
        of_q, of_v = self.matrices
        return of_q[:, : 3 * n] @ x, of_v[:, : 3 * n] @ x

    def vjp(self, dq1: ArrayLike, dv1: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the gradients by q, v and tau of dq1 . q+ + dv1 . v+, for dq1 and dv1 (nv,)."""
        n, (of_q, of_v) = len(self.v), self.matrices
        x = finite("dq1", dq1, n) @ of_q + finite("dv1", dv1, n) @ of_v
        return x[:n], x[n : 2 * n], x[2 * n : 3 * n]

    @property
    def columns(self) -> Columns:
        """Where each part stands in `matrices`."""
        n, k = len(self.v), len(self.names)
        return Columns(n, k, self.matrices[0].shape[1] - Columns(n, k).size)

    def _check(self, parameter: str) -> None:
        if parameter not in self.parameters:
            raise InvalidArgument(
                f"{parameter}: this step by {self.route!r} has derivatives by q, v, "
                f"tau{', '.join(('', *self.parameters))}; more are in them with "
                'derivatives(wrt=["inertias"]) and the like'
            )

    def __repr__(self) -> str:
        modes = list(self.modes.values())
        counts = ", ".join(f"{modes.count(m)} {m}" for m in MODES if m in modes) or "no contacts"
        sided = "; one-sided" if self.one_sided else ""
        return f"StepDerivatives({self.route!r}: {counts}{sided})"


def differentiated(route: Route, steps: LinearSteps, ended: Ended) -> StepDerivatives:
    """Return the derivatives of a step that has ended."""
    if not isfinite(ended.dq.sum() + ended.dv.sum()):
        raise SolveFailed(f"{route!r}: the derivatives of this step are not finite", None)
    state, matrices = (ended.q, ended.v), (ended.dq, ended.dv)
    is_at_a_kink = route.is_smooth and _is_at_a_kink(steps, ended.posed)
    margin = 0.0 if is_at_a_kink else _margin(steps, ended)
    return made(route, steps, state, matrices, modes_of(steps, ended), margin, ended.notes)


def made(
    route: Route, steps: LinearSteps, state: tuple[Array, Array],
    matrices: tuple[Array, Array], modes: dict[str, str], margin: float,
    notes: tuple[Note, ...] = (),
) -> StepDerivatives:  # fmt: skip
    """Return the derivatives with these `matrices`, of a step that ends in this `state`."""
    candidates, parameters = steps.system.contacts, found_parameters(route, steps.scheme, steps.wrt)
    q, v, dq, dv = read_only((*state, *matrices))
    names = candidates.names[: candidates.cones]
    return StepDerivatives(q, v, modes, margin, route, names, (dq, dv), parameters, notes)


def found_parameters(route: Route, scheme: ContactScheme, wrt: Sequence[str]) -> tuple[str, ...]:
    """Return what there are derivatives by, beside q, v and tau, where `wrt` is asked for."""
    left_out = set(route.on_request) - set(wrt)
    return tuple(name for name in route.parameters(scheme) if name not in left_out)


def modes_of(steps: LinearSteps, ended: Ended) -> dict[str, str]:
    """Return the modes of all contacts in a step that has ended."""
    posed, names = ended.posed, steps.system.contacts.names
    modes = dict.fromkeys(names, MODES[OPEN])
    for name, code in zip(posed.problem.names, _found(posed.problem, ended.law), strict=True):
        modes[name] = MODES[code]
    return modes


def _found(problem: ContactProblem, law: Law) -> list[int]:
    """Return the modes of the contacts that take part."""
    found = law.modes
    if found is None:
        found = contact_modes(problem, law.lam, 100 * tolerances.CONTACT_POLISHED)
    return found.tolist()  # type: ignore[no-any-return]


def _is_at_a_kink(steps: LinearSteps, posed: Posed) -> bool:
    """Return whether a gap is where a scheme begins to push out, or lets a contact take part.

    Between a gap of zero and a penetration of a nanometre nothing is pushed out, deeper a fifth of
    it, and no gap closes further than to zero: kinks of a scheme, whatever the law of a route.
    Where contacts take part from a gap of zero on, a step jumps there.
    """
    gaps = posed.near.gaps if steps.scheme.closes_gaps else posed.gaps
    off = np.maximum(gaps, -AT_REST - gaps) if steps.scheme.closes_gaps else np.abs(gaps)
    return bool((off < tolerances.TOUCHES).any())


def _margin(steps: LinearSteps, ended: Ended) -> float:
    """Return how far a step is from other modes, relative to its velocities and to g dt.

    By complementarity: a contact changes its mode where both of a pair are small, impulse and
    velocity, or slip and what is left of the cone. Of what takes no part the impulse is zero,
    and the other one the gap / dt by which it misses.
    """
    posed, lam = ended.posed, ended.law.lam
    speed = posed.problem.scale[1] if posed.problem.rows else 0.0
    off = ended.law.margin * speed if posed.problem.rows else inf
    if not posed.chosen.is_everything:
        away = ~posed.chosen.near
        missed = (posed.gaps[away] - steps.scheme.touching) / steps.dt
        if steps.scheme.closes_gaps:
            missed += posed.J[steps.system.contacts.normals[away]] @ posed.velocity(lam)
        off = min(off, float(np.abs(missed).min()))
    return off / max(speed, steps.falls)
