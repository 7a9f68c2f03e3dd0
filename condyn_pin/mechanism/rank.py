"""Rank, mobility, and the check of a scene.

Rank: independent rows of a scene at one configuration.

With M = L L^T and the whitened Jacobian J L^-T, whose squared singular values are the eigenvalues
of the Delassus matrix J M^-1 J^T,

    mobility = nv - rank J,          Gruebler's count = nv - m,

and the two differ by the redundant rows. A row can be redundant at every configuration, as the one
across the plane of a planar loop, or at this one only: then it is singular.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised, renamed
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import MinimumNorm, redundant_rows
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import (
    ConstraintViolation,
    beyond_text,
    closed,
    largest_violation,
)
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    gaps,
    kept_rows,
    rounding,
    to_close,
)
from condyn_pin.dynamics.nominal import digits_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import NotAssembled
from condyn_pin.mechanism.assembling import nominal_configuration
from condyn_pin.mechanism.closed_chains import chains_of, factors_at

_NEARLY_SINGULAR = 1e-4  # of the singular values
_EPS = float(np.finfo(float).eps)

# A part of a gap that no motion removes, to first order, as a share of it.
_CURVED = 0.1

# Rows with less of a singular vector, as a share of its largest entry, are not named.
_NAMED = 0.1


@dataclass(frozen=True, eq=False)
class Rank:
    """Rank, mobility and conditions at one configuration.

    Attributes
    ----------
    q : (nq,) array
        Configuration [rad, m].
    violation : dict of str to ConstraintViolation
        How far each loop is open at q [m, rad].
    rows, rank, generic_rank : int
        m; independent rows at q; independent rows at configurations near the first posture that
        are not singular by accident.
    mobility, gruebler : int
        nv - rank, the degrees of freedom left, as directions of the velocity; nv - m, as if every
        row counted.
    redundant : tuple of str
        Rows that can go at q without changing the motion, as ``constraint.axis``.
    generic_redundant : tuple of str
        Rows that can go at configurations that are not singular by accident.
    isolated : tuple of str
        Loops that close at the first posture and nowhere near it: bars that just reach. Singular
        values that the gap beside it hides then count as zeros.
    conflict : dict of str to float
        Rows that cannot be closed together, and by how much: the part of c(q) that no motion
        removes, to first order [m, rad].
    weak : tuple of str
        Nearly redundant rows: those along which singular values are below 1e-4 of the largest, and
        not zero.
    singular_values : (min(m, nv),) array
        Of J L^-T [1/sqrt(kg)].
    condition, delassus_condition : float
        Condition numbers of M, and of the nonzero part of J M^-1 J^T.
    to_close : dict of str to ConstraintViolation
        `violation` without what the digits of a file leave open, within `Robot.precision`.
    digits : str
        What the digits of the file make up, if that is anything: rows that it makes count are left
        out, up to `Robot.precision`.
    """

    q: Array
    violation: Mapping[str, ConstraintViolation]
    rows: int
    rank: int
    generic_rank: int
    mobility: int
    gruebler: int
    redundant: tuple[str, ...]
    generic_redundant: tuple[str, ...]
    isolated: tuple[str, ...]
    conflict: Mapping[str, float]
    weak: tuple[str, ...]
    singular_values: Array  # [1/sqrt(kg)]
    condition: float
    delassus_condition: float
    to_close: Mapping[str, ConstraintViolation]
    digits: str = ""

    gap = renamed("violation")

    @property
    def licq(self) -> bool:
        """True if all rows are independent: linear independence constraint qualification."""
        return self.rank == self.rows

    @property
    def closed(self) -> bool:
        """True if every loop is closed to 1e-10, but for what digits leave open."""
        return closed(self.to_close)

    @property
    def singular(self) -> bool:
        """True if the rank is lower than at configurations nearby."""
        return self.rank < self.generic_rank

    @property
    def only_here(self) -> tuple[str, ...]:
        """The redundant rows of a singular configuration that count nearby."""
        kept = [name for name in self.redundant if name not in self.generic_redundant]
        return tuple(kept) if self.singular else ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Notices, a sentence each."""
        return tuple(self._notes())

    def __str__(self) -> str:
        lines = [
            f"{self.rows} rows, rank {self.rank}, mobility {self.mobility} "
            f"(Gruebler's count {self.gruebler})",
            f"redundant rows: {', '.join(self.redundant) or 'none'}",
            f"condition of M {self.condition:.1e}, of the Delassus matrix "
            f"{self.delassus_condition:.1e}",
        ]
        return "\n".join([*lines, *self.notes])

    def _notes(self) -> Iterator[str]:
        if self.digits:
            yield self.digits
        if not self.closed:
            name, gap = largest_violation(self.to_close)
            yield f"{name} is open by {gap}: Scene.assemble closes it"
        if self.conflict:
            size = max(self.conflict.values())
            yield (
                f"{', '.join(self.conflict)} contradict each other by {size:.3g} m or rad: no "
                "motion from here closes them all, and no acceleration satisfies them; leave one "
                "out, or move its frames"
            )
        if self.singular:
            yield (
                f"singular configuration: rank {self.rank} here, {self.generic_rank} nearby; "
                f"{', '.join(self.only_here)} redundant only here; J says less than the loops "
                "do, and accelerations can be wrong"
            )
            if self.isolated:
                yield (
                    f"{', '.join(self.isolated)} closes here and nowhere near: no motion leads "
                    "away, whatever J leaves free"
                )
        elif self.rank and self.singular_values[self.rank - 1] < (
            _NEARLY_SINGULAR * self.singular_values[0]
        ):
            share = self.singular_values[self.rank - 1] / self.singular_values[0]
            yield (
                "nearly singular: constraint forces are large and badly determined here, along "
                f"{', '.join(self.weak)}, and grow without bound on the way to the singular "
                f"configuration; a and J^T lam are unique, to about {_EPS / share:.0e}"
            )
        if self.closed and self.rank > self.generic_rank:
            yield (
                f"rank {self.rank} here, {self.generic_rank} near the first posture, which is "
                "singular in its neighbourhood too, or on another branch"
            )


@one_blas_thread
def rank(scene: Scene, q: ArrayLike | None) -> Rank:
    """Return the rank of a scene at q; see `Scene.rank`."""
    robot, model = scene.robot, scene.robot.model
    robot.check_unedited()
    q_ = nominal_configuration(scene) if q is None else normalised(model, "q", q)
    chains, equations = chains_of(scene), equations_of(scene)
    terms = equations.consistent_terms(q_, np.zeros(model.nv))
    share = tolerances.ISOLATED if chains.isolated else tolerances.RANK
    factors = factors_at(equations, q_, terms, share)
    S, r = factors.S, factors.rank
    c, digits = equations.violation(q_), digits_of(scene)
    closing = to_close(scene, q_, c)
    return Rank(
        q=q_.copy(),
        violation=gaps(scene, c),
        rows=scene.rows,
        rank=r,
        generic_rank=chains.rank,
        mobility=robot.nv - r,
        gruebler=robot.nv - scene.rows,
        redundant=redundant_rows(factors.U[:, r:], scene.row_names, chains.redundant),
        generic_redundant=chains.redundant,
        isolated=chains.isolated,
        conflict=_conflict(factors.U[:, min(r, chains.rank) :], closing, scene.row_names),
        weak=_weak(factors, scene.row_names),
        singular_values=S,
        condition=float(np.linalg.cond(terms.M)),
        delassus_condition=float((S[0] / S[r - 1]) ** 2) if r else 1.0,
        to_close=gaps(scene, closing),
        digits=digits.note if digits else "",
    )


def _conflict(null: Array, c: Array, names: Sequence[str]) -> dict[str, float]:
    """Part of c that lies in the null space of J^T, by rows."""
    # A part that is small beside the gap may be its square, which the next step towards closed
    # loops takes away.
    part = np.abs(null @ (null.T @ c))
    largest, gap = float(part.max(initial=0.0)), float(np.abs(c).max(initial=0.0))
    if largest <= max(tolerances.CLOSED, _CURVED * gap):
        return {}
    rows = np.flatnonzero(part > _NAMED * largest).tolist()
    return {names[i]: float(part[i]) for i in rows}


def _weak(factors: MinimumNorm, names: Sequence[str]) -> tuple[str, ...]:
    """Return the rows along which singular values are small."""
    S = factors.S[: factors.rank]
    along = np.abs(factors.U[:, : factors.rank][:, _NEARLY_SINGULAR * S.max(initial=0.0) > S])
    if not along.size:
        return ()
    rows = np.flatnonzero((along > _NAMED * along.max(axis=0)).any(axis=1)).tolist()
    return tuple(names[i] for i in rows)


# Check: which loop is open and by how much, and which velocity does not fit.


@dataclass(frozen=True, eq=False)
class Check:
    """Violation of the constraints by a state.

    Attributes
    ----------
    violation : dict of str to ConstraintViolation
        How far each loop and each anchored contact is open [m, rad].
    constraint_velocity : dict of str to ConstraintViolation
        How fast the two sides of each constraint move apart, |J v| [m/s, rad/s].
    speed : float
        max abs(v), or 1, whichever is larger: what |J v| is compared with.
    beyond_limits : dict of str to ConstraintViolation
        Joints outside their limits, and how far [rad, m]. The dynamics know no limits.
    rounding : dict of str to float
        What rounding alone may leave of |J v|: 1e-13 of the velocities that it is the difference
        of [m/s, rad/s]. Looked at where |J v| is more than 1e-10 of `speed`.
    to_close : dict of str to ConstraintViolation, optional
        `violation` without what the digits of a file leave open, within `Robot.precision`; by
        default all of it. `constraint_velocity` is without that too.
    """

    violation: Mapping[str, ConstraintViolation]
    constraint_velocity: Mapping[str, ConstraintViolation]
    speed: float  # [rad/s, m/s]
    beyond_limits: Mapping[str, ConstraintViolation]  # [rad, m]
    rounding: Mapping[str, float] = field(default_factory=dict)  # [m/s, rad/s]
    to_close: Mapping[str, ConstraintViolation] | None = None

    gap = renamed("violation")
    slip = renamed("constraint_velocity")

    @property
    def closed(self) -> bool:
        """True if every gap is within 1e-10, but for what digits leave open."""
        return closed(self._to_close)

    @property
    def _to_close(self) -> Mapping[str, ConstraintViolation]:
        return self.violation if self.to_close is None else self.to_close

    @property
    def consistent(self) -> bool:
        """True if J v = 0 to 1e-10, relative to `speed`, or to `rounding`."""
        return not self._moving(tolerances.CONSISTENT)

    @property
    def ok(self) -> bool:
        """True if the state satisfies the constraints."""
        return self.closed and self.consistent

    def raise_if_open(
        self,
        *,
        violation: float = tolerances.CLOSED,
        constraint_velocity: float = tolerances.CONSISTENT,
    ) -> None:
        """Raise if the state does not satisfy the constraints.

        Parameters
        ----------
        violation : float
            The largest violation that will do [m, rad].
        constraint_velocity : float
            The largest |J v| that will do, relative to `speed`.

        Raises
        ------
        NotAssembled
            The text names every loop that is open, and every constraint with J v other than zero.
        """
        wrong = self._open(violation)
        advice = ["Scene.assemble closes the loops"] if wrong else []
        if moving := self._moving(constraint_velocity):
            wrong += moving
            advice.append("mechanism.project_velocity makes v fit")
        if wrong:
            raise NotAssembled(f"{', '.join(wrong)}; {'; '.join(advice)}")

    def __str__(self) -> str:
        lines = self._open(tolerances.CLOSED) or ["every loop is closed"]
        lines += self._moving(tolerances.CONSISTENT) or (
            ["J v = 0"] if self.constraint_velocity else []
        )
        lines += [beyond_text(self.beyond_limits)] if self.beyond_limits else []
        return "\n".join(lines)

    def _open(self, most: float) -> list[str]:
        return [
            f"{name} is open by {gap}" for name, gap in self._to_close.items() if gap.size > most
        ]

    def _moving(self, most: float) -> list[str]:
        return [
            f"{name} has |J v| = {velocity.text('/s')}"
            for name, velocity in self.constraint_velocity.items()
            if not velocity.size <= max(most * self.speed, self.rounding.get(name, 0.0))
        ]


def check(scene: Scene, q: ArrayLike, v: ArrayLike | None) -> Check:
    """Return gaps and constraint velocities of a state; see `Scene.check`."""
    model, equations = scene.robot.model, equations_of(scene)
    q_ = normalised(model, "q", q)
    chains = chains_of(scene)
    velocities, speed, excused = {}, 1.0, {}
    if v is not None:
        v_ = finite("v", v, model.nv)
        J, rate = kept_rows(scene, equations.jacobian(q_), -equations.wanted[1])
        velocities = constraint_velocities(scene, J @ v_ + rate)
        speed = float(np.abs(v_).max(initial=1.0))
        if any(each.size > tolerances.CONSISTENT * speed for each in velocities.values()):
            excused = rounding(scene, q_, v_)
    c = equations.violation(q_)
    beyond, closing = chains.limits.beyond(q_), gaps(scene, to_close(scene, q_, c))
    return Check(gaps(scene, c), velocities, speed, beyond, excused, closing)
