"""The contract of a time-stepping scheme with contacts, and how to write one.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = s' - dt gamma / 2
    sigma = G lam + g,    K contains lam,    K* contains sigma + (0, 0, mu |sigma_t|),   orthogonal

A scheme says where M, h and J are taken, which contacts are active, what g is, and how the velocity
moves the configuration. All else is that of `ContactSteps`.

1. Add one file to `stepping/schemes/` with a frozen dataclass that inherits from `ContactScheme`.
2. Set `law`, and `at_midpoint` if M, h, J and the gaps are those of q (+) dt v / 2; then q moves by
   dt (v + v+) / 2, else by dt v+. Set `closes_gaps` if g closes gaps at the end of the step.
3. Write `near`, `bias`, which returns g and R, and `bias_partials`, how they change. Write `start`,
   which returns `contact_stepper(self, system, dt)`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import Law, components
from condyn_pin.contact.restitution import ImpactAnswer, RestitutionLaw
from condyn_pin.contact.solvers.admm import ADMM
from condyn_pin.contact.solvers.contact_solver import ContactSolver
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.integrator import Integrator, Order

# Contacts further away take no part, unless the robot moves further in two steps [m].
_NEAR = 1e-3

# Share of a penetration that a step takes back, and how deep one is that stays [m, rad]: what steps
# leave of a gap that they close is 1e-11. Pushed out, that would slide against dry friction, or
# push redundant contacts against each other, with impulses up to the limits of friction.
_PUSHED_OUT, AT_REST = 0.2, 1e-9

# How fast a penetration is pushed out at most [m/s, rad/s]: a body keeps that velocity, and is
# thrown up by 2 mm.
PUSHES: Final = 0.2

# Compliance of compliant pushes, relative to G_nn, and of what does not; shares of a push that
# count as all of it and as none of it, and the part of one that keeps rounding from contradiction.
_YIELDS: Final = 1e-4
_HARD: Final = 1e-10
_ALL, _NONE, _BUT_ROUNDING = 0.99, 1e-3, 1.0 - 1e-6

# Gaps that are rounding [m, rad].
_TOUCHES = 1e-13

_NO_GAPS: Final = np.zeros(0)

# Members that a scheme of a user's own may define under their names of the last version.
_RENAMED: Final = {
    "asked": "bias",
    "asked_by": "bias_partials",
    "gives_way": "penetrates_at_rest",
}


class ActiveContacts(NamedTuple):
    """The active contacts of a step, as a scheme sees them."""

    dt: float  # time step [s]
    gaps: Array  # (k,) of cones and half-lines [m, rad]
    # (k,) how far curved paths take them from gap + dt J_n v+ [m]; zero if the scheme closes no
    # gaps
    bends: Array
    restitution: Array  # (k,) of the same, zero of half-lines [1]
    normals: Indices | slice  # (k,) their rows along the normal
    G: Array  # (m, m) [1/kg]
    # before, free (m,): J_c v, and J_c v+ of a step without impulses [m/s]
    before: Array
    free: Array
    blocks: Indices  # (m,) which contact each row belongs to
    # (k,) by how much gaps may shrink in the step, of a scheme that closes them; of what is pushed
    # out that is negative [m, rad]
    allowed: Array = _NO_GAPS

    @property
    def pressed(self) -> NDArray[np.bool_]:
        """Flags (k,) of penetrations pushed out by less than each would be alone."""
        return self.pushed_by_less_than(_ALL)

    def pushed_by_less_than(self, share: float) -> NDArray[np.bool_]:
        """Flags (k,) of penetrations pushed out by less than a share of the push of each alone."""
        if len(self.allowed) < 2:
            return np.zeros(len(self.gaps), dtype=bool)
        alone = allowed_gaps(self.gaps, self.dt)
        return np.asarray((alone < 0.0) & (self.allowed > share * alone))

    @property
    def depth(self) -> Array:
        """Gap of the contact of each row, zero of dry friction (m,) [m, rad]."""
        return self._by_row(self.gaps, np.zeros(len(self.free)))

    @property
    def stiffness(self) -> Array:
        """G_nn of the contact of each row, its own entry of dry friction (m,) [1/kg]."""
        diagonal = self.G.diagonal()
        return self._by_row(diagonal[self.normals], diagonal)

    def behind(self, strike: ImpactAnswer) -> ActiveContacts:
        """The contacts after an impact; those that rebound keep their separating velocity."""
        # g_n = J_n v_free - max(J_n v', 0),    v' the velocity behind the impact
        m = len(strike.lam)
        thrown = self.G[:, :m].dot(strike.lam)
        free, n = self.free + thrown, self.normals
        off = np.maximum(self.before[n] + thrown[n], 0.0)
        free[n] -= np.where(strike.apart, off, 0.0)
        return self._replace(free=free, restitution=np.where(strike.apart, 0.0, self.restitution))

    def _by_row(self, of_contacts: Array, of_dry: Array) -> Array:
        """Return numbers of contacts and stops, and for dry friction those of its rows."""
        k = len(self.gaps)
        values = of_dry.copy()
        rows = self.blocks < k
        values[rows] = of_contacts[self.blocks[rows]]
        return values


class BiasPartials(NamedTuple):
    """Partial derivatives of g and R of a contact scheme; None where they are zero."""

    # gaps, bends (k,): g of the normal rows by gaps and bends [1/s]
    gaps: Array | None = None
    bends: Array | None = None
    before: Array | None = None  # (m,) g by the velocity before, each row by its own
    restitution: Array | None = None  # (k,) g of the normal rows by the coefficient [m/s]
    solref: Array | None = None  # (m, 2) g by the two numbers of a soft scheme
    R_gaps: Array | None = None  # (m,) R by the gap of its contact [1/(kg m)]
    R_stiffness: Array | None = None  # (m,) R by G_nn of its contact [1]


@dataclass(frozen=True)
class ContactScheme(Integrator, ABC):
    """A time-stepping scheme whose contacts open, stick and slide within the step.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.

    Raises
    ------
    InvalidArgument
        If `contact` is no contact solver, or does not solve the law of the scheme.
    """

    order: ClassVar[Order] = Order(1, 1, 1)  # of v 2 where nothing touches, and no body floats
    solves_per_step: ClassVar[float] = 2
    a_at = "end"
    keeps_constraints: ClassVar[bool] = True
    takes_contacts: ClassVar[bool] = True

    law: ClassVar[Law] = "ncp"
    at_midpoint: ClassVar[bool] = False
    # whether no gap is below zero at the end of a step, of what was near before it or not
    closes_gaps: ClassVar[bool] = False
    # whether what rests on a plane follows it where its path bends, of a scheme that closes no gaps
    follows_planes: ClassVar[bool] = False
    touching: ClassVar[float] = 0.0  # gap up to which contacts are active, if no others do [m, rad]
    takes_restitution: ClassVar[bool] = False
    penetrates_at_rest: ClassVar[bool] = False  # whether contacts at rest penetrate

    contact: ContactSolver = ADMM()  # noqa: RUF009  a value

    def __init_subclass__(cls) -> None:
        for old, now in _RENAMED.items():
            if old in vars(cls):
                raise InvalidArgument(f"{cls.__name__}.{old}: its name is `{now}` now; rename it")
        super().__init_subclass__()

    def __post_init__(self) -> None:
        check_type(
            "contact", self.contact, ContactSolver, "a contact solver is needed, such as ADMM()"
        )
        if self.law not in self.contact.laws:
            raise InvalidArgument(
                f"contact = {self.contact!r}: {self.title} poses the {self.law}, and "
                f"{self.contact.title} solves {' and '.join(self.contact.laws)}; use ADMM()"
            )

    @property
    def impacts(self) -> RestitutionLaw | None:
        """The law by which contacts rebound; None where none does."""
        return None

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Flags of gaps (k,) [m, rad] so small that their contacts are active in a step."""
        return np.asarray(gaps < max(_NEAR, 2 * dt * fastest(v)))

    def check(self, candidates: Candidates) -> None:
        """Refuse `candidates` that rebound where the scheme lets none."""
        if self.takes_restitution or not candidates.restitution.any():
            return
        k = int(candidates.restitution.argmax())
        raise InvalidArgument(
            f"{candidates.names[k]}: restitution = {candidates.restitution[k]:g}, and "
            f"{self.title} lets nothing rebound; use Moreau(), or restitution=0"
        )

    @abstractmethod
    def bias(self, near: ActiveContacts) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] and R (m,) [1/kg] of contacts that are `near`; no R if hard."""

    def bias_partials(self, near: ActiveContacts) -> BiasPartials:
        """Partial derivatives of `bias` by `near`, without that of g by `free`: the identity."""
        return BiasPartials()


def closing_velocities(near: ActiveContacts) -> Array:
    """Return g of gaps that are zero at the end of a step, and penetrations a fifth less."""
    # g_n = J_n v_free + (s + gap) / dt  (gap > 0),    J_n v_free + s / dt - p  (gap < 0)
    # with p = min(-0.2 gap / dt, 0.2 m/s), or what of it a rigid motion can follow. Where G_nn is
    # zero, constraints hold the contact: it goes where they go, whatever is asked for.
    g, n = near.free.copy(), near.normals
    g[n] += (near.bends + near.allowed) / near.dt
    stiff = near.G.diagonal()
    if 0.0 in stiff.tolist():
        g[n] = np.where(stiff[n] == 0.0, np.maximum(g[n], 0.0), g[n])
    return g


def fastest(v: Array) -> float:
    """Largest absolute value of velocities (nv,)."""
    sizes: map[float] = map(abs, v.tolist())
    return max(sizes)  # numpy's own takes three times as long for those of a robot


def are_slower(v: Array, limit: float) -> bool:
    """True if all velocities (nv,) are below `limit`; the cheaper test of v . v comes first."""
    return bool(v.dot(v) < limit * limit) or fastest(v) < limit


def allowed_gaps(gaps: Array, dt: float) -> Array:
    """Allowed decrease of gaps in a step (k,): to zero, and penetrations by -0.2 of them."""
    # A penetration of up to a nanometre stays; no other is pushed out faster than at `PUSHES`.
    return np.array([_allowed(gap, -PUSHES * dt) for gap in gaps.tolist()])


def _allowed(gap: float, fastest: float) -> float:
    if gap > _TOUCHES:
        return gap
    return max(_PUSHED_OUT * gap, fastest) if gap < -AT_REST else 0.0


def yielding_gaps(near: ActiveContacts) -> Array:
    """Allowed decrease of gaps (k,) [m, rad], where opposing pushes yield to other contacts."""
    #     y = argmin_{y >= 0}  y . (G_nn + soft) y / 2 - ask . y
    # with ask = p and a little softness of what is pushed out, and ask = -gap / dt of all else,
    # which is hard. The motion M^-1 J_n^T y can follow p' = min(p, G_nn y), and Signorini's
    # condition allows it: a body between two walls that overlap by more than its size stays in
    # place.
    allowed = allowed_gaps(near.gaps, near.dt)
    if len(allowed) < 2 or not min(allowed.tolist()) < 0.0:
        return allowed
    rows = np.arange(len(near.free))[near.normals]
    N = near.G[rows[:, None], rows]
    moved = N.diagonal() > 0.0  # all else is held by constraints
    for island in components((N != 0.0) & moved):
        its = np.flatnonzero(island & moved)
        if len(its) > 1 and (allowed[its] < 0.0).any():
            wanted, bent = -allowed[its] / near.dt, near.bends[its] / near.dt
            followed = _feasible_pushes(N[its[:, None], its], wanted, bent)
            less = followed < wanted
            allowed[its[less]] = -near.dt * followed[less]
    return allowed


def _feasible_pushes(N: Array, wanted: Array, bent: Array) -> Array:
    """Feasible part of the push velocities `wanted` (k,), which are p or -gap / dt [m/s]."""
    # `bent` is the velocity by path curvature.
    from scipy.optimize import nnls

    size, pushed = np.sqrt(N.diagonal()), wanted > 0.0
    S = N / np.multiply.outer(size, size)
    ask, soft = (wanted - bent) / size, np.where(pushed, _YIELDS, _HARD)
    if not np.isfinite(S.sum() + ask.sum()):  # which the step finds out
        return wanted
    for _ in range(len(N) + 1):
        L = np.linalg.cholesky(S + np.diag(soft))
        try:
            y, _ = nnls(L.T, np.linalg.solve(L, ask))
        except RuntimeError:  # out of iterations: as it was
            return wanted
        got = (S @ y) * size + bent
        sinks = (got < -1e-6 * wanted.max()) & (soft == _YIELDS)
        if not sinks.any():
            break
        soft[sinks], ask[sinks] = _HARD, -bent[sinks] / size[sinks]
    part = np.where(got <= _NONE * wanted, 0.0, np.minimum(got, wanted) * _BUT_ROUNDING)
    return np.where(pushed & (got < _ALL * wanted), np.maximum(part, 0.0), wanted)


def closing_by(near: ActiveContacts) -> BiasPartials:
    """Partial derivatives of `closing_velocities` by gaps and bends."""
    # A contact that rests, up to a nanometre deep, has the slope of an open one: rounding of a zero
    # gap has no effect.
    # numbers one by one: for the few of a robot they take half the time of numpy's calls
    gaps = [
        (1.0 if gap >= -AT_REST else _PUSHED_OUT if allowed == _PUSHED_OUT * gap else 0.0) / near.dt
        for gap, allowed in zip(near.gaps.tolist(), near.allowed.tolist(), strict=True)
    ]
    return BiasPartials(gaps=np.array(gaps), bends=np.array(len(gaps) * [1 / near.dt]))


def sizes_of_gaps() -> tuple[float, float, float, float, float]:
    """Gap thresholds of a step, for the compiled core."""
    # Largest gap of an active contact [m], share of a penetration that a step removes, its largest
    # speed [m/s, rad/s], depth that stays, and gap of a touching contact [m, rad].
    return _NEAR, _PUSHED_OUT, PUSHES, AT_REST, _TOUCHES
