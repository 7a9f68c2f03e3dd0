"""StepDerivatives: derivatives of the end of a step with contacts by its start."""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgetrf, dgetri, dlange

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices, finite, read_only
from condyn_pin._core.jacobian import Block, Jacobian
from condyn_pin.contact.indeterminacy import COMPLIANCE, compliance
from condyn_pin.contact.problem import MODES, OPEN, ContactProblem, Modes, contact_modes
from condyn_pin.errors import CondynError, InvalidArgument, SolveFailed
from condyn_pin.simulation.integrators.contact_scheme import AT_REST, ContactScheme
from condyn_pin.simulation.records import Note
from condyn_pin.stepping.step_problem import StepProblem

if TYPE_CHECKING:
    from condyn_pin.gradients.routes.linear_steps import LinearizedEnd, LinearizedStep
    from condyn_pin.gradients.routes.route import Route


class StepJacobian(Jacobian, ABC):
    """Derivatives of the end of a step, of one state or of many; rows and columns of q are tangent.

    `matrices` have the `columns` of q, v, tau and all parameters side by side.
    """

    outputs = "q", "v"
    route: Route
    names: tuple[str, ...]
    matrices: tuple[Array, Array]
    parameters: tuple[str, ...]

    dq_dq = Block("q+ by q (..., nv, nv).")
    dq_dv = Block("q+ by v (..., nv, nv).")
    dq_dtau = Block("q+ by the torques (..., nv, nv).")
    dv_dq = Block("v+ by q (..., nv, nv).")
    dv_dv = Block("v+ by v (..., nv, nv).")
    dv_dtau = Block("v+ by the torques (..., nv, nv).")
    dv_dfriction = Block("v+ by the friction of each contact (..., nv, k).")
    dv_drestitution = Block("v+ by restitution (..., nv, k), of schemes that let contacts rebound.")
    dv_dsolref = Block("v+ by the two numbers of `solref` (..., nv, 2), where contacts have them.")
    dv_dinertias = Block("v+ by inertias (..., nv, 10 a joint), as `KktDerivatives.by_inertias`.")

    @property
    def columns(self) -> Columns:
        """Columns of each input in `matrices`."""
        (n, size), cones = self.matrices[0].shape[-2:], len(self.names)
        return Columns(n, cones, size - Columns(n, cones).size)

    @property
    def inputs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of q, v, tau and the parameters."""
        return "q", "v", "tau", *self.parameters

    @property
    def matrix(self) -> Array:
        """Derivatives of q+ and v+ by all `columns` (..., 2 nv, columns)."""
        return np.concatenate(self.matrices, axis=-2)

    def block(self, output: str, by: str) -> Array:
        """Return the derivative of q+ or v+ by an input (..., nv, columns)."""
        if by not in self.inputs:
            raise self._unknown(by)
        return self.matrices[self.outputs.index(output)][..., self.columns.of(by)]

    def _unknown(self, parameter: str) -> CondynError:
        return InvalidArgument(
            f"{parameter}: this step by {self.route!r} has derivatives by "
            f"{', '.join(self.inputs)}; more are in them with "
            'derivatives(wrt=["inertias"]) and the like'
        )


@dataclass(frozen=True, eq=False, repr=False)
class StepDerivatives(StepJacobian):
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
        Distance of the nearest contact from another mode, in units of the contact problem [1].
    route : Route
    names : tuple of str
        The contacts with friction: the columns by friction and by restitution.
    parameters : tuple of str
        Parameters of the derivatives, beside q, v and tau.
    matrices : tuple of (nv, columns) array
        q+ and v+ by q, v, tau, friction, restitution and solref, side by side [mixed], and by
        inertias if they were asked for.
    notes : tuple of Note
        Reasons for derivatives by a rule, or of one side: Coulomb's law does not determine
        velocities, contacts share an impact in several ways, or opposing pushes limit each other.
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
        """True if the derivative holds on one side only, or by a rule.

        A contact is so near to another mode, or `notes` give the reason.
        """
        return self.margin < tolerances.SWITCHES

    @property
    def notices(self) -> tuple[str, ...]:
        """Warnings about the derivatives, one sentence each."""
        return tuple(note.text for note in self.notes)

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

    def __repr__(self) -> str:
        modes = list(self.modes.values())
        counts = ", ".join(f"{modes.count(m)} {m}" for m in MODES if m in modes) or "no contacts"
        sided = "; one-sided" if self.one_sided else ""
        return f"StepDerivatives({self.route!r}: {counts}{sided})"


def differentiated(route: Route, steps: LinearizedStep, ended: LinearizedEnd) -> StepDerivatives:
    """Return the derivatives of a step that has ended."""
    if not isfinite(ended.dq.sum() + ended.dv.sum()):
        raise SolveFailed(f"{route!r}: the derivatives of this step are not finite", None)
    state, matrices = (ended.q, ended.v), (ended.dq, ended.dv)
    is_at_a_kink = route.is_smooth and _is_at_a_kink(steps, ended.posed)
    margin = 0.0 if is_at_a_kink else _margin(steps, ended)
    return step_derivatives_of(
        route, steps, state, matrices, modes_of(steps, ended), margin, ended.notes
    )


def step_derivatives_of(
    route: Route, steps: LinearizedStep, state: tuple[Array, Array],
    matrices: tuple[Array, Array], modes: dict[str, str], margin: float,
    notes: tuple[Note, ...] = (),
) -> StepDerivatives:  # fmt: skip
    """Return the derivatives with these `matrices`, of a step that ends in this `state`."""
    contacts, (q, v, dq, dv) = steps.system.contacts, read_only((*state, *matrices))
    return StepDerivatives(
        q=q, v=v, modes=modes, margin=margin, route=route, names=contacts.names[: contacts.cones],
        matrices=(dq, dv), parameters=found_parameters(route, steps.scheme, steps.wrt), notes=notes,
    )  # fmt: skip


def found_parameters(route: Route, scheme: ContactScheme, wrt: Sequence[str]) -> tuple[str, ...]:
    """Parameters of the derivatives beside q, v and tau, those of `wrt` included."""
    left_out = set(route.on_request) - set(wrt)
    return tuple(name for name in route.parameters(scheme) if name not in left_out)


def modes_of(steps: LinearizedStep, ended: LinearizedEnd) -> dict[str, str]:
    """Return the modes of all contacts in a step that has ended."""
    posed, names = ended.posed, steps.system.contacts.names
    modes = dict.fromkeys(names, MODES[OPEN])
    for name, code in zip(posed.problem.names, _modes_of(posed.problem, ended.law), strict=True):
        modes[name] = MODES[code]
    return modes


def _modes_of(problem: ContactProblem, law: ContactLaw) -> list[int]:
    """Return the modes of the active contacts."""
    found = law.modes
    if found is None:
        found = contact_modes(problem, law.lam, 100 * tolerances.CONTACT_POLISHED)
    return found.tolist()  # type: ignore[no-any-return]


def _is_at_a_kink(steps: LinearizedStep, posed: StepProblem) -> bool:
    """True if a gap is at the threshold of push-out, or at that of becoming active.

    Between a gap of zero and a penetration of a nanometre nothing is pushed out, deeper a fifth of
    it, and no gap closes further than to zero: kinks of a scheme, whatever the law of a route.
    Where contacts become active at a gap of zero, a step jumps there.
    """
    gaps = posed.near.gaps if steps.scheme.closes_gaps else posed.gaps
    off = np.maximum(gaps, -AT_REST - gaps) if steps.scheme.closes_gaps else np.abs(gaps)
    return bool((off < tolerances.TOUCHES).any())


def _margin(steps: LinearizedStep, ended: LinearizedEnd) -> float:
    """Distance of a step from other modes, relative to its velocities and to g dt [1].

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


# Columns: what the end of a step is differentiated by, and where each part stands.
#
# Within a step q stands for where its equations are taken, v and tau are theirs (`StartChainRule`).


# What the end of a step may depend on, beside its start and the torques.
PARAMETERS: Final = ("friction", "restitution", "solref", "inertias")


class Columns:
    """The columns of all derivatives of a step: q, v, tau, and each of `PARAMETERS`.

    Inertias have none, unless there are `inertias` of them that are asked for.
    """

    def __init__(self, nv: int, cones: int, inertias: int = 0) -> None:
        self.nv, self.cones = nv, cones
        self.q, self.v, self.tau = (slice(i * nv, (i + 1) * nv) for i in range(3))
        self.friction = slice(3 * nv, 3 * nv + cones)
        self.restitution = slice(3 * nv + cones, 3 * nv + 2 * cones)
        self.solref = slice(3 * nv + 2 * cones, 3 * nv + 2 * cones + 2)
        first = 3 * nv + 2 * cones + 2
        self.inertias, self.size = slice(first, first + inertias), first + inertias

    def of(self, parameter: str) -> slice:
        """Return the columns of one of `PARAMETERS`, or of tau."""
        found: slice = getattr(self, parameter)
        return found

    def of_cones(self, parameter: str, cones: NDArray[np.bool_] | slice) -> slice | Indices:
        """Return the columns of friction or restitution of some cones, by flags, or of all."""
        of_all = self.of(parameter)
        return of_all if isinstance(cones, slice) else np.arange(of_all.start, of_all.stop)[cones]

    def empty(self, rows: int | None = None) -> Array:
        """Return zeros (rows, columns), nv rows by default."""
        return np.zeros((self.nv if rows is None else rows, self.size))


# Law: what a route takes the law of the contacts for, at one answer.
#
#     by_sigma dsigma + by_lam dlam + by_friction dmu + by_size dsize = 0
#
# One such row for each of the problem: with sigma = G lam + g it is the change of lam
# by that of g, G and mu.


# Singular values of a law that redundant contacts leave, relative to the largest.
_REDUNDANT: Final = 1e-10


class ContactLaw(NamedTuple):
    """A linearised law of contacts.

    Attributes
    ----------
    lam : (m,) array
        Impulses that the law holds for [N s].
    by_sigma, by_lam : (m, m) array
    by_friction : (m, k) array
        By the coefficient of each cone of the problem.
    margin : float
        How far the nearest contact is from another mode, in units of the problem [1].
    by_size : (m,) array, optional
        By (m g dt) (g dt) of the robot and the step, of a law whose smoothness goes with it [1/J].
    modes : (contacts,) array of int, optional
        Of a law that is made of them.
    """

    lam: Array
    by_sigma: Array
    by_lam: Array
    by_friction: Array
    margin: float
    by_size: Array | None = None
    modes: Modes | None = None

    def giving_way(self, problem: ContactProblem) -> ContactLaw:
        """Return the law of slightly compliant contacts, all alike: of an answer chosen by that."""
        if self.modes is None:
            return self
        R = COMPLIANCE * compliance(problem)
        return self._replace(by_lam=self.by_lam + self.by_sigma * R)


def minimum_norm_solution(A: Array, b: Array) -> Array:
    """Return x of A x = b (m,) or (m, columns), the smallest one where contacts are redundant.

    By A^-1 and one step of refinement, which is as exact as LAPACK's solution for each column: of
    many columns that takes ten times as long as products do.
    """
    lu, pivots, info = dgetrf(A)
    if not info:
        inverse, info = dgetri(lu, pivots)
    if info or not dlange("1", A) * dlange("1", inverse) * _REDUNDANT < 1:
        return np.asarray(np.linalg.lstsq(A, b, rcond=_REDUNDANT)[0])
    x = inverse.dot(b)
    x += inverse.dot(b - A.dot(x))
    return np.asarray(x)
